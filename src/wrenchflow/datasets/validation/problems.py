"""What is wrong with a data set: each problem says in which file, episode, column and row."""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

# Problems of one kind that are told one by one; the rest is counted.
_TOLD = 10


@dataclass(frozen=True, kw_only=True)
class Problem:
    """Something that is wrong.

    Attributes:
        kind: What kind of thing, such as `not-finite`.
        file: In which file.
        what: What is wrong, with what was got and what was expected.
        episode: In which episode; empty for the file as a whole.
        column: In which column; empty for an episode as a whole.
        row: In which row, from 0; None for a column as a whole.
    """

    kind: str
    file: str
    what: str
    episode: str = ""
    column: str = ""
    row: int | None = None

    def __str__(self) -> str:
        """One line."""
        row = "" if self.row is None else f"row {self.row}"
        return ": ".join(part for part in (self.file, self.episode, self.column, row, self.what) if part)


@dataclass(kw_only=True)
class Problems:
    """Gathers problems, and keeps no more of a kind than a person reads.

    Attributes:
        file: The file that problems are in where nothing else is said.
        found: The problems, in the order in which they were found.
        counts: How many there are of each kind.
    """

    file: str
    found: list[Problem] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)

    def add(self, kind: str, what: str, *, episode: str = "", column: str = "", row: int | None = None) -> None:
        """Take one in."""
        self.counts[kind] += 1
        if self.counts[kind] <= _TOLD:
            self.found.append(Problem(kind=kind, file=self.file, what=what, episode=episode, column=column, row=row))

    def lines(self) -> list[str]:
        """All that is kept, a line each, and how many more there are of each kind."""
        more = {kind: count - _TOLD for kind, count in self.counts.items() if count > _TOLD}
        rest = [f"{self.file}: {count} more of the kind {kind}" for kind, count in more.items()]
        return [str(problem) for problem in self.found] + rest

    def require_finite(self, values: np.ndarray, *, episode: str, column: str) -> None:
        """Look for values that are no numbers, and name the first row of them."""
        if values.dtype.kind == "f" and not np.isfinite(values).all():
            bad = ~np.isfinite(values.reshape(len(values), -1)).all(axis=1)
            row = int(np.argmax(bad))
            value = values.reshape(len(values), -1)[row]
            shown = value[~np.isfinite(value)][0]
            more = f", and in {int(bad.sum()) - 1} rows more" if bad.sum() > 1 else ""
            self.add("not-finite", f"the value is {shown}{more}", episode=episode, column=column, row=row)

    def require_increasing(self, t: np.ndarray, *, episode: str, column: str) -> None:
        """Look for stamps that do not increase."""
        steps = np.diff(t)
        if (steps <= 0).any():
            row = int(np.argmax(steps <= 0)) + 1
            self.add("time", f"{t[row]} comes after {t[row - 1]}", episode=episode, column=column, row=row)

    def require_unit_quaternions(self, values: np.ndarray, *, episode: str, column: str) -> None:
        """Look for quaternions whose norm is not 1."""
        norm = np.linalg.norm(values.astype(np.float64), axis=1)
        bad = ~(np.abs(norm - 1.0) < 1e-3)
        if bad.any():
            row = int(np.argmax(bad))
            self.add("range", f"a quaternion of norm {norm[row]:.4g}", episode=episode, column=column, row=row)
