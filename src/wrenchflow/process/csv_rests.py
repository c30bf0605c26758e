"""Poses and wrenches from a CSV file, for who calibrates from what another program logged."""

import csv
from pathlib import Path

import numpy as np

from wrenchflow.episode import Episode, Stream
from wrenchflow.errors import RecordingError, unknown
from wrenchflow.signals import POSE, WRENCH

# Time [s], wrench in the sensor frame as robot on environment [N, N.m], T_base_tcp [m, unit quaternion].
COLUMNS = ("t", *WRENCH.columns, *POSE.columns)
_FURTHEST_S = 8e9  # From 1970 on until long after 2200; what is further does not fit into 64 bits of nanoseconds.


def read_csv(path: Path) -> Episode:
    """Read a CSV file whose first line names its columns: those of `COLUMNS` in any order; others are not looked at.

    Raises:
        RecordingError: If it cannot be read, a column is missing or there twice, or a value is no number.
        StreamError: If time does not go on.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = csv.reader(file)
            header = [name.strip() for name in next(lines, [])]
            columns = [_place(header, name, path) for name in COLUMNS]
            rows = [
                _numbers([line[i] if i < len(line) else "" for i in columns], lines.line_num, path)
                for line in lines
                if line
            ]
    except FileNotFoundError as error:
        raise RecordingError(f"'{path}' does not exist.") from error
    except (UnicodeDecodeError, csv.Error, OSError) as error:
        raise RecordingError(f"'{path}' cannot be read as CSV: {error}") from error
    table = np.array(rows, np.float64).reshape(-1, len(COLUMNS))
    if not (np.abs(table[:, 0]) < _FURTHEST_S).all():  # A NaN is no time.
        raise RecordingError(f"'{path}': column 't' holds values that are no seconds, such as milliseconds since 1970.")
    t = np.rint(table[:, 0] * 1e9).astype(np.int64)
    wrench, pose = table[:, 1 : 1 + WRENCH.width].copy(), table[:, 1 + WRENCH.width :].copy()
    streams = {"wrench_raw": Stream(t, wrench, WRENCH, "sensor"), "tcp_pose": Stream(t, pose, POSE, "base")}
    return Episode(path.stem, "calibration", streams)


def _place(header: list[str], name: str, path: Path) -> int:
    if header.count(name) == 1:
        return header.index(name)
    if name in header:
        raise RecordingError(f"'{path}': column '{name}' is there {header.count(name)} times, expected once.")
    raise RecordingError(f"'{path}': {unknown('column', name, header)} Expected: {', '.join(COLUMNS)}.")


def _numbers(values: list[str], line: int, path: Path) -> list[float]:
    numbers = []
    for name, value in zip(COLUMNS, values, strict=True):
        try:
            numbers.append(float(value) if value.strip() else float("nan"))
        except ValueError as error:
            raise RecordingError(f"'{path}', line {line}: {name} is {value[:40]!r}, expected a number.") from error
    return numbers
