"""Tables of text: a row a sample, a column a channel."""

import csv
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.errors import RecordingError, unknown
from wrenchflow.imports.mapping import Clock, FileLayout, Values
from wrenchflow.imports.stamps import to_ns
from wrenchflow.imports.take import TopicRows


class Table:
    """A table that was read, as text; it is one take."""

    def __init__(self, path: Path, layout: FileLayout) -> None:
        """Read it.

        Raises:
            RecordingError: If it cannot be read, is empty, or its rows are not equally long.
        """
        self.id, self._path = path.stem, path
        try:
            with path.open(newline="", encoding="utf-8-sig") as file:
                rows = [row for row in csv.reader(file, delimiter=layout.delimiter) if row]
        except FileNotFoundError as error:
            raise RecordingError(f"file '{path}' does not exist.") from error
        except (OSError, UnicodeDecodeError, csv.Error) as error:
            raise RecordingError(f"{path} cannot be read as a table: {error}") from error
        width = len(rows[0]) if rows else 0
        names = [name.strip() for name in rows[0]] if rows and layout.header else [f"{i + 1}" for i in range(width)]
        cells = rows[1:] if layout.header else rows
        if not cells:
            raise RecordingError(f"{path} holds no rows, expected one a sample{' below the names' * bool(rows)}.")
        if len(set(names)) != len(names):
            twice = next(name for name in names if names.count(name) > 1)
            raise RecordingError(
                f"{path} has {names.count(twice)} columns called '{twice}', expected names of their own."
            )
        self._first = 2 if layout.header else 1
        for number, row in enumerate(cells, self._first):
            if len(row) != width:
                raise RecordingError(f"{path}: row {number} has {len(row)} cells, expected {width}.")
        self._columns = dict(zip(names, zip(*cells, strict=True), strict=True))

    def numbers(self, part: Values, width: int | None, where: str) -> Float[np.ndarray, "n k"]:
        """See `Take`; an empty cell is a NaN."""
        if part.variable:
            raise RecordingError(
                f"{where}: {self._path} is a table and has no variables: its columns have to be stated."
            )
        return np.stack([self._numbers(name, where) for name in part.columns], axis=1)

    def stamps(self, clock: Clock, where: str) -> Int64[np.ndarray, " n"]:
        """See `Take`."""
        assert clock.unit is not None  # The mapping was checked.
        return to_ns(self._cells(clock.stamps, where), clock.unit, f"{self._path}: column '{clock.stamps}'")

    def topic(self, name: str, where: str) -> TopicRows:
        """See `Take`."""
        raise RecordingError(f"{where}: {self._path} is a table and has no topic '{name}'.")

    def _cells(self, name: str, where: str) -> tuple[str, ...]:
        if name not in self._columns:
            raise RecordingError(f"{where}: {unknown(f'column of {self._path}', name, self._columns)}")
        return self._columns[name]

    def _numbers(self, name: str, where: str) -> Float[np.ndarray, " n"]:
        cells = self._cells(name, where)
        out = np.full(len(cells), np.nan)
        for row, cell in enumerate(cells):
            if text := cell.strip():
                try:
                    out[row] = float(text)
                except ValueError as error:
                    raise RecordingError(
                        f"{self._path}: column '{name}' has '{text}' in row {row + self._first}, expected a number."
                    ) from error
        return out
