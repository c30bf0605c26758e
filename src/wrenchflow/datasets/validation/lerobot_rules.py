"""The rules of a LeRobotDataset v3.0 folder: the small files against the rows, the rows against each other."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from wrenchflow.datasets import lerobot_layout as layout
from wrenchflow.datasets.analysis.lerobot_folder import Folder, read_folder
from wrenchflow.datasets.arrow import values_of
from wrenchflow.datasets.running import Running
from wrenchflow.datasets.summary import summarise
from wrenchflow.datasets.validation.members import Members
from wrenchflow.datasets.validation.problems import Problems
from wrenchflow.errors import DatasetError, RecordingError
from wrenchflow.manifest import read_json

_COUNTED = ("total_episodes", "total_frames", "total_tasks")
# Of a time stamp [s], which single precision holds so well after some hours; numbers of rows are whole.
_TOLERANCE_S = 1e-3
_CHECKED = ("min", "max", "mean", "std", "count")


def check(root: Path) -> Problems:
    """Everything that is wrong with a folder; an episode at a time.

    Raises:
        DatasetError: If it is no LeRobot v3 data set at all.
    """
    problems = Problems(file=root.name)
    folder = read_folder(root)
    members, totals = Members(), {"total_episodes": len(folder.rows), "total_frames": 0}
    running: dict[str, Running] = {}
    tasks = _tasks(root, problems)
    totals["total_tasks"] = len(tasks)
    wanted = [name for name, feature in folder.info["features"].items() if feature["dtype"] not in ("video", "image")]
    expected = 0
    for number, row in sorted(folder.rows.items()):
        name = f"episode {number}"
        if row["dataset_from_index"] != expected:
            what = f"begins at row {row['dataset_from_index']}, expected {expected}"
            problems.add("length", what, episode=name, column="dataset_from_index")
        expected = row["dataset_from_index"] + row["length"]
        try:
            table = folder.table(row, wanted)
            columns = {column: values_of(table[column], column) for column in wanted if column in table.column_names}
        except (DatasetError, OSError, pa.ArrowException, IndexError) as error:
            problems.add("layout", str(error).rstrip("."), episode=name)
            continue
        totals["total_frames"] += row["length"]
        _check_rows(columns, row, name, folder, tasks, problems)
        for column, values in columns.items():
            if np.isfinite(values).all() if values.dtype.kind == "f" else values.dtype.kind in "iub":
                running.setdefault(column, Running()).add(values, summarise(values))
        content = [values for column, values in columns.items() if column == "action" or column in _seen(columns)]
        members.add(name, content, str(folder.told.get(number, {}).get("recording_id", "")))
    for what in _COUNTED:
        if folder.info.get(what) != totals[what]:
            problems.add("length", f"is {folder.info.get(what)}, expected {totals[what]}", column=f"info.json: {what}")
    _check_statistics(root, running, problems)
    _check_videos(root, folder, problems)
    members.check(_masks(root, folder), problems)
    return problems


def _seen(columns: Mapping[str, np.ndarray]) -> set[str]:
    """What a policy sees; stamps are not, and differ in copies."""
    return {column for column in columns if column.startswith("observation.") and column != layout.TIME_NS}


def _check_rows(
    columns: Mapping[str, np.ndarray],
    row: Mapping[str, Any],
    name: str,
    folder: Folder,
    tasks: Sequence[str],
    problems: Problems,
) -> None:
    length, fps = row["length"], float(folder.info["fps"])
    for column, feature in folder.info["features"].items():
        if feature["dtype"] in ("video", "image"):
            continue
        values = columns.get(column)
        if values is None:
            problems.add("layout", "is missing", episode=name, column=column)
            continue
        shape = tuple(feature["shape"])
        if values.shape[1:] != (() if shape == (1,) else shape) and values.shape[1:] != shape:
            what = f"has rows of shape {values.shape[1:]}, info.json says {shape}"
            problems.add("shape", what, episode=name, column=column)
        problems.require_finite(values, episode=name, column=column)
    frame = np.arange(length)
    begin = row["dataset_from_index"]
    for column, wanted in (
        ("frame_index", frame),
        ("index", begin + frame),
        ("episode_index", np.full(length, row["episode_index"])),
        ("timestamp", (frame / fps).astype(np.float32)),
    ):
        values = columns.get(column)
        if values is not None and len(values) == length and (apart := np.abs(values - wanted) > _TOLERANCE_S).any():
            at = int(np.argmax(apart))
            problems.add("time", f"is {values[at]}, expected {wanted[at]}", episode=name, column=column, row=at)
    numbers = columns.get("task_index")
    if numbers is not None and len(numbers) and not 0 <= numbers.min() <= numbers.max() < max(len(tasks), 1):
        what = f"names task {int(numbers.max())}, there are {len(tasks)}"
        problems.add("layout", what, episode=name, column="task_index")
    if layout.TIME_NS in columns:
        problems.require_increasing(columns[layout.TIME_NS], episode=name, column=layout.TIME_NS)


def _tasks(root: Path, problems: Problems) -> list[str]:
    try:
        return [str(task) for task in pq.read_table(root / "meta" / "tasks.parquet")["task"].to_pylist()]
    except (OSError, KeyError, pa.ArrowException) as error:
        problems.add("layout", f"cannot be read: {error}", column="meta/tasks.parquet")
        return []


def _check_statistics(root: Path, running: Mapping[str, Running], problems: Problems) -> None:
    """Least, greatest, mean and deviation of all rows against what stats.json says of them."""
    try:
        said = read_json(root / "meta" / "stats.json")
    except RecordingError as error:
        problems.add("statistics", str(error).rstrip("."), column="meta/stats.json")
        return
    for feature, of in running.items():
        if feature not in said:
            problems.add("statistics", "has no statistics", column=f"stats.json: {feature}")
            continue
        found = of.moments()
        for what in _CHECKED:
            told, true = np.asarray(said[feature].get(what, ()), np.float64).ravel(), found[what].astype(np.float64)
            scale = np.maximum(np.abs(found["std"]), 1e-6 * np.maximum(np.abs(true), 1.0))
            if told.shape != true.ravel().shape or (np.abs(told - true.ravel()) > 1e-3 * scale + 1e-9).any():
                shown = f"{_short(told)}, the rows make {_short(true.ravel())}"
                problems.add("statistics", f"is {shown}", column=f"stats.json: {feature}.{what}")


def _short(values: np.ndarray) -> str:
    shown = " ".join(f"{value:.6g}" for value in values[:6])
    return shown + (" ..." if len(values) > 6 else "") if len(values) else "missing"


def _check_videos(root: Path, folder: Folder, problems: Problems) -> None:
    """Whether the files are there that the table of episodes names; their pictures are not decoded."""
    features = [name for name, feature in folder.info["features"].items() if feature["dtype"] == "video"]
    if not features:
        return
    tables = [pq.read_table(path).to_pylist() for path in sorted((root / "meta" / "episodes").rglob("*.parquet"))]
    for row in (row for table in tables for row in table):
        name = f"episode {row['episode_index']}"
        for feature in features:
            try:
                place = {key: row[f"videos/{feature}/{key}"] for key in ("chunk_index", "file_index")}
                seconds = row[f"videos/{feature}/to_timestamp"] - row[f"videos/{feature}/from_timestamp"]
            except KeyError as error:
                problems.add("layout", f"the table of episodes lacks {error}", episode=name, column=feature)
                continue
            path = layout.VIDEO.format(video_key=feature, **place)
            if not (root / path).is_file() or not (root / path).stat().st_size:
                problems.add("layout", f"{path} is not there", episode=name, column=feature)
            expected = row["length"] / float(folder.info["fps"])
            if abs(seconds - expected) > 0.5 / float(folder.info["fps"]):
                what = f"lasts {seconds:.3f} s, its rows {expected:.3f} s"
                problems.add("length", what, episode=name, column=feature)


def _masks(root: Path, folder: Folder) -> dict[str, list[str]]:
    """Ours, by our own file; LeRobot itself has ranges of episodes, of which it uses one."""
    if (root / layout.OURS).exists():
        masks = read_json(root / layout.OURS).get("masks", {})
        return {str(name): [f"episode {i}" for i in members] for name, members in masks.items()}
    found = {}
    for name, span in (folder.info.get("splits") or {}).items():
        first, _, last = str(span).partition(":")
        if first.isdecimal() and last.isdecimal():
            found["valid" if name in ("val", "valid", "test") else name] = [
                f"episode {i}" for i in range(int(first), int(last))
            ]
    return found
