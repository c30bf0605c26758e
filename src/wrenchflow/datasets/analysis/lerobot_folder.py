"""A LeRobotDataset v3.0 folder, ours or another's: state and action by the names of their columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from wrenchflow.datasets import lerobot_layout as layout
from wrenchflow.datasets.analysis import names
from wrenchflow.datasets.analysis import trajectory as of
from wrenchflow.datasets.analysis.config import AnalysisConfig
from wrenchflow.datasets.analysis.touch import touching
from wrenchflow.datasets.analysis.trajectory import Labels, Table, Trajectory
from wrenchflow.datasets.arrow import values_of
from wrenchflow.errors import DatasetError, RecordingError
from wrenchflow.manifest import read_json

_EPISODES = "meta/episodes"
_OF_EPISODES = ("episode_index", "tasks", "length", "data/chunk_index", "data/file_index", "dataset_from_index")
_LABELS = (*names.LABS, *names.COLLECTORS, *names.SCENES, *names.OUTCOMES)


@dataclass(frozen=True, kw_only=True)
class LeRobotFolder:
    """A folder.

    Attributes:
        root: Where it is.
    """

    root: Path

    kind = "LeRobotDataset v3.0"

    def places(self) -> list[str]:
        """Numbers of its episodes."""
        return [str(number) for number in _opened(self.root).rows]

    def read(self, place: str, config: AnalysisConfig) -> Trajectory:
        """Read one of them."""
        try:
            return _opened(self.root).trajectory(int(place), config)
        except (OSError, pa.ArrowException, KeyError, TypeError, ValueError) as error:
            raise DatasetError(f"it cannot be read: {error}") from error


@dataclass(frozen=True, kw_only=True, eq=False)
class Folder:
    """A folder of which the small files are read.

    Attributes:
        root: Where it is.
        info: `meta/info.json`.
        rows: Where each episode lies, by its number.
        told: What our own table says of each, if it is ours.
    """

    root: Path
    info: Mapping[str, Any]
    rows: Mapping[int, Mapping[str, Any]]
    told: Mapping[int, Mapping[str, Any]]

    def trajectory(self, number: int, config: AnalysisConfig) -> Trajectory:
        """An episode."""
        row = self.rows[number]
        wanted = [
            name
            for name, feature in self.info["features"].items()
            if feature["dtype"] not in ("video", "image") and name != layout.WINDOW
        ]
        table = self.table(row, wanted)
        rate_hz = float(self.info["fps"])
        parts: dict[str, np.ndarray] = {}
        tables: dict[str, Table] = {}
        for feature, name in ((layout.STATE, of.STATE), (layout.ACTION, of.ACTION)):
            if feature in table.column_names:
                data = _numbers(table, feature)
                columns = _columns(self.info, feature, data.shape[1])
                tables[name] = Table(columns=columns, units=("",) * len(columns), data=data)
                parts |= names.by_prefix(columns, data) if name == of.STATE else {}
        for feature in table.column_names:
            if feature.startswith("observation.") and feature not in (layout.STATE, layout.WINDOW):
                short = feature.removeprefix("observation.").removeprefix("state.")
                if pa.types.is_floating(_innermost(table.schema.field(feature).type)):
                    parts.setdefault(short, _numbers(table, feature))
        position, joints = names.first(parts, names.POSITIONS), names.first(parts, names.JOINTS)
        wrench, torque = names.first(parts, names.WRENCHES), names.first(parts, names.TORQUES)
        contact = None
        if wrench is not None and wrench.shape[1] == 6:
            tables[of.WRENCH] = Table(columns=of.WRENCH_COLUMNS, units=of.WRENCH_UNITS, data=wrench)
            contact = touching(wrench[:, :3], round(config.tare_s * rate_hz))
        if torque is not None:
            width = torque.shape[1]
            tables[of.JOINT_TORQUE] = Table(
                columns=tuple(f"tau{i + 1}" for i in range(width)), units=("N.m",) * width, data=torque
            )
        is_timed = layout.TIME_NS in table.column_names
        t = table[layout.TIME_NS if is_timed else "timestamp"].to_numpy()
        looked_for = {"position": position, "joint angles": joints, "force": wrench}
        told = self.told.get(number, {})
        return Trajectory(
            id=str(told.get("episode_id", f"episode {number}")),
            place=f"episode {number}",
            labels=_labels(table, row, told),
            seconds=(t - t[0]) * 1e-9 if is_timed else (t - t[0]).astype(np.float64),
            nominal_hz=rate_hz,
            is_timed=is_timed,
            position_m=None if position is None else position[:, :3],
            joints_rad=joints,
            tables=tables,
            contact=contact,
            contact_by="" if contact is None else of.WRENCH,
            missing=tuple(name for name, found in looked_for.items() if found is None)
            + (() if is_timed else ("time stamps",)),
        )

    def table(self, row: Mapping[str, Any], columns: Sequence[str]) -> pa.Table:
        """The rows of an episode; only those row groups of its file are read that hold some of them.

        Args:
            row: The episode's, of `rows`.
            columns: Those that are wanted.

        Raises:
            DatasetError: If its file holds other rows.
        """
        path = self.root / layout.DATA.format(chunk_index=row["data/chunk_index"], file_index=row["data/file_index"])
        file, first = _file(path, path.stat().st_mtime_ns)
        begin = row["dataset_from_index"] - first
        groups, before, skipped = [], 0, 0
        for group in range(file.num_row_groups):
            count = file.metadata.row_group(group).num_rows
            if before + count <= begin:
                skipped += count
            elif before < begin + row["length"]:
                groups.append(group)
            before += count
        table = file.read_row_groups(groups, columns=list(columns)).slice(begin - skipped, row["length"])
        if len(table) != row["length"] or table["episode_index"].unique().to_pylist() != [row["episode_index"]]:
            raise DatasetError(
                f"'{path.name}' does not hold the {row['length']} rows of episode {row['episode_index']}."
            )
        return table


@lru_cache(maxsize=2)
def _opened(root: Path) -> Folder:
    return read_folder(root)


def read_folder(root: Path) -> Folder:
    """Read the small files of a folder.

    Raises:
        DatasetError: If they cannot be read, are of another version, or name no episode.
    """
    try:
        info = read_json(root / layout.INFO)
        version = str(info["codebase_version"])
        if not version.startswith("v3"):
            raise DatasetError(
                f"'{root}' is a LeRobot {version} data set; wrenchflow reads v3.0. LeRobot brings it there: python -m "
                "lerobot.scripts.convert_dataset_v21_to_v30."
            )
        tables = [
            pq.read_table(path, columns=list(_OF_EPISODES)) for path in sorted((root / _EPISODES).rglob("*.parquet"))
        ]
        rows = {row["episode_index"]: row for row in (pa.concat_tables(tables).to_pylist() if tables else ())}
        ours = root / layout.OUR_EPISODES
        told = {row["episode_index"]: row for row in pq.read_table(ours).to_pylist()} if ours.exists() else {}
    except (RecordingError, OSError, pa.ArrowException, KeyError, TypeError) as error:
        raise DatasetError(f"'{root}' cannot be read as a LeRobot data set: {error}") from error
    if not rows:
        raise DatasetError(f"'{root}' has no episodes in {_EPISODES}.")
    return Folder(root=root, info=info, rows=rows, told=told)


@lru_cache(maxsize=4)
def _file(path: Path, changed_ns: int) -> tuple[pq.ParquetFile, int]:
    """A data file, and the number in the data set of its first row; `changed_ns` tells it from another of its name."""
    file = pq.ParquetFile(path, pre_buffer=False)
    return file, int(file.read_row_group(0, columns=["index"])["index"][0].as_py())


def _columns(info: Mapping[str, Any], feature: str, width: int) -> tuple[str, ...]:
    """Names of a feature's columns, which others give as a list or under one more name."""
    found: Any = info["features"].get(feature, {}).get("names")
    if isinstance(found, Mapping):
        found = next(iter(found.values()), None)
    if isinstance(found, Sequence) and len(found) == width:
        return tuple(str(name) for name in found)
    return tuple(f"{i + 1}" for i in range(width))


def _numbers(table: pa.Table, feature: str) -> np.ndarray:
    values = values_of(table[feature], feature).astype(np.float64)
    return values.reshape(len(values), -1)


def _innermost(kind: pa.DataType) -> pa.DataType:
    while pa.types.is_list(kind) or pa.types.is_fixed_size_list(kind) or pa.types.is_large_list(kind):
        kind = kind.value_type
    return kind


def _labels(table: pa.Table, row: Mapping[str, Any], told: Mapping[str, Any]) -> Labels:
    """From the first row of the episode, where others write them, and our own table."""
    said: dict[str, Any] = {
        name: table[name][0].as_py() for name in _LABELS if name in table.column_names and len(table)
    }
    said |= told
    success = names.first(said, names.OUTCOMES)
    if isinstance(success, list):
        success = success[0] if success else None
    return Labels(
        task=str(", ".join(row["tasks"] or ()) or names.first(said, names.TASKS) or ""),
        lab=str(names.first(said, names.LABS) or ""),
        collector=str(names.first(said, names.COLLECTORS) or ""),
        scene=str(names.first(said, names.SCENES) or ""),
        success=None if success is None else bool(success),
    )
