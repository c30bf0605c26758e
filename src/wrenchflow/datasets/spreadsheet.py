"""Writes one flat table, a row a step, for spreadsheets and notebooks: Parquet, or CSV.

Force windows and pictures have no place in a row and are left out.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from pyarrow import csv

from wrenchflow.datasets import increments, keys
from wrenchflow.datasets.about import About
from wrenchflow.datasets.keys import keys_of, to_keys
from wrenchflow.datasets.masks import Member, masks_of
from wrenchflow.datasets.sink import add_all
from wrenchflow.errors import DatasetError, OutputError
from wrenchflow.manifest import partial_of, write_json
from wrenchflow.observation import Steps

_TOLD = ("episode_id", "recording_id", "task", "operator", "success")


def write(path: Path, steps: Sequence[Steps], about: About, *, overwrite: bool = False) -> None:
    """Write episodes that are in memory; `writing` says the rest."""
    with writing(path, about, overwrite=overwrite) as sink:
        add_all(sink, steps)


@contextmanager
def writing(path: Path, about: About, *, overwrite: bool = False) -> Iterator["SpreadsheetSink"]:
    """Write a data set as one table; the suffix of the path, `.parquet` or `.csv`, says which kind.

    Heads carry the unit, as in `force_torque.fx [N]`. How values came about is in `<stem>.json` beside the table, with
    the masks.

    Args:
        path: The file; it is called `<path>.partial` until the block ends well.
        about: What is known of the whole.
        overwrite: Replace a file that is there.

    Raises:
        DatasetError: If there was no episode.
        OutputError: If the path is taken or cannot be written.
    """
    if path.exists() and not overwrite:
        raise OutputError(f"output '{path}' exists already. Choose another place, or pass --overwrite.")
    partial = partial_of(path)
    try:
        partial.parent.mkdir(parents=True, exist_ok=True)
        sink = SpreadsheetSink(partial, about, is_csv=path.suffix == ".csv")
        try:
            yield sink
            described = sink.finish()
        finally:
            sink.close()
        with partial.open("rb") as written:
            os.fsync(written.fileno())
        os.replace(partial, path)
        write_json(path.with_suffix(path.suffix + ".json"), described)
    except (OSError, pa.ArrowException) as error:
        raise OutputError(f"output '{path}' cannot be written: {error}") from error


class SpreadsheetSink:
    """Takes episodes into an open table."""

    def __init__(self, path: Path, about: About, *, is_csv: bool) -> None:
        self._path, self._about, self._is_csv = path, about, is_csv
        self._writer: Any = None
        self._first: Steps | None = None
        self._members: list[Member] = []

    def add(self, steps: Steps) -> None:
        """Write an episode."""
        self._first = self._first or steps
        table = _table(steps)
        if self._writer is None:
            self._writer = (
                csv.CSVWriter(self._path, table.schema)
                if self._is_csv
                else pq.ParquetWriter(self._path, table.schema, compression="zstd", use_dictionary=list(_TOLD))  # pyright: ignore[reportArgumentType]
            )
        self._writer.write_table(table)
        self._members.append(Member.of(steps))

    def finish(self) -> dict[str, Any]:
        """What is known of the whole."""
        if self._first is None:
            raise DatasetError("there is no episode to export.")
        masks = masks_of(self._members, self._about)
        return {**self._about.described(self._first), "masks": {name: list(of) for name, of in masks.items()}}

    def close(self) -> None:
        """Close the file."""
        if self._writer is not None:
            self._writer.close()


def _table(steps: Steps) -> pa.Table:
    count = len(steps)
    told = {name: pa.array([getattr(steps, name)] * count) for name in _TOLD}
    columns: dict[str, np.ndarray] = {
        "step": np.arange(count),
        "time_ns": steps.t,
        "time [s]": (steps.t - steps.t[0]) * 1e-9,
    }
    values = to_keys(steps.observations)
    for key in keys_of(steps.observations):
        if values[key.name].ndim == 2:
            for i, (column, unit) in enumerate(zip(key.columns, key.units, strict=True)):
                columns[f"{key.name}.{column} [{unit}]"] = values[key.name][:, i]
    made = increments.increments(steps.observations["tcp_pose"], steps.actions)
    for what, names, units, of in (
        ("action", keys.ACTION_COLUMNS, keys.ACTION_UNITS, steps.actions),
        ("action_increment", increments.COLUMNS, increments.UNITS, made),
    ):
        columns |= {f"{what}.{n} [{unit}]": of[:, i] for i, (n, unit) in enumerate(zip(names, units, strict=True))}
    columns |= {f"skew.{name} [ns]": of for name, of in steps.skew_ns.items()}
    columns |= {f"valid.{name}": of for name, of in steps.valid.items()}
    return pa.table({**told, **{name: pa.array(np.ascontiguousarray(of)) for name, of in columns.items()}})
