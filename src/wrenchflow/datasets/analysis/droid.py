"""DROID's raw tree: `<lab>/{success,failure}/<date>/<time>/trajectory.h5`, with `metadata_<uuid>.json` beside it.

It has no force sensor: what it measures is the torque of the motors, gravity included, from which a wrench is
estimated. Everything but the joints' angles is optional here, for releases differ; what is lacking is said.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5d, h5f, h5g, h5s  # pyright: ignore[reportAttributeAccessIssue]

from wrenchflow.datasets.analysis import trajectory as of
from wrenchflow.datasets.analysis.config import AnalysisConfig
from wrenchflow.datasets.analysis.external_wrench import JOINTS, estimate_wrench
from wrenchflow.datasets.analysis.source import relative
from wrenchflow.datasets.analysis.trajectory import Labels, Table, Trajectory
from wrenchflow.errors import DatasetError, RecordingError
from wrenchflow.manifest import read_json

NAME = "trajectory.h5"
RATE_HZ = 15.0
# A force whose squared distance from zero is at least this is one: of three normal numbers, one row in a thousand is.
_TOUCH = 16.27
_STATE, _STAMPS = "observation/robot_state", "observation/timestamp"
_CONTROL, _ROBOT, _CAMERAS = f"{_STAMPS}/control", f"{_STAMPS}/robot_state", f"{_STAMPS}/cameras"
_ACTION = "action/cartesian_velocity"
_ACTION_COLUMNS = ("vx", "vy", "vz", "wx", "wy", "wz")
_NAMES = tuple(f"tau{i + 1}" for i in range(JOINTS))
_OUTCOMES = {"success": True, "failure": False}


@dataclass(frozen=True, kw_only=True)
class DroidTree:
    """A folder with such trees in it.

    Attributes:
        root: The folder.
    """

    root: Path

    kind = "DROID"

    def places(self) -> list[str]:
        """Each `trajectory.h5`, in the order of their paths; videos are not looked at."""
        found = []
        for folder, folders, files in os.walk(self.root):
            folders[:] = sorted(name for name in folders if name != "recordings")
            if NAME in files:
                found.append(relative(Path(folder, NAME), self.root))
        return found

    def read(self, place: str, config: AnalysisConfig) -> Trajectory:
        """Read one episode."""
        path = self.root / place
        metadata, missing = _metadata(path.parent)
        try:
            # One plain way into the file: h5py's own objects take several times as long to make as the numbers.
            file = h5f.open(os.fsencode(path), h5f.ACC_RDONLY)
        except OSError as error:
            raise DatasetError(f"it cannot be read as HDF5: {error}") from error
        try:
            columns = _Columns(file)
            columns.missing += missing
            return _trajectory(columns, place, metadata, config)
        except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
            raise DatasetError(f"it cannot be read as an episode of DROID: {error}") from error
        finally:
            file.close()


class _Columns:
    """Columns of one open file, all of the same length."""

    def __init__(self, file: Any) -> None:
        self._file = file
        self._steps: int | None = None
        self.missing: list[str] = []

    def find(self, name: str, width: int = 0) -> np.ndarray | None:
        """A column as float64 [(T,) or (T, width)], or None; what is there but has another shape is refused."""
        try:
            data = h5d.open(self._file, name.encode())
        except (KeyError, ValueError):  # There is no such link, or something else lies there.
            return None
        shape = data.shape
        steps = shape[0] if self._steps is None and shape else self._steps
        if shape != (expected := (steps, width) if width else (steps,)):
            raise DatasetError(f"'{name}' has shape {shape}, expected {expected}")
        self._steps = shape[0]
        # HDF5 does not turn flags, which are an enumeration to it, into numbers.
        values = np.empty(shape, data.dtype if data.get_type().get_class() == h5py.h5t.ENUM else np.float64)
        if values.size:
            data.read(h5s.ALL, h5s.ALL, values)
        return values

    def wanted(self, name: str, width: int = 0) -> np.ndarray | None:
        """The same, and where it is not there, that is said."""
        found = self.find(name, width)
        if found is None:
            self.missing.append(name)
        return found

    def names(self, group: str) -> list[str]:
        """What is in a group; nothing where there is none."""
        try:
            return [name.decode() for name in h5g.open(self._file, group.encode())]
        except (KeyError, ValueError):
            return []

    def attributes(self) -> Mapping[str, Any]:
        """Attributes of the file."""
        return dict(h5py.Group(h5g.open(self._file, b"/")).attrs)


def _metadata(folder: Path) -> tuple[Mapping[str, Any], list[str]]:
    """What the file beside a trajectory says, and what is wrong with it."""
    for entry in sorted(os.listdir(folder)):
        if entry.startswith("metadata_") and entry.endswith(".json"):
            try:
                found = read_json(folder / entry)
            except RecordingError:
                return {}, ["metadata (not JSON)"]
            return (found, []) if isinstance(found, Mapping) else ({}, ["metadata (no object)"])
    return {}, ["metadata"]


def _trajectory(columns: _Columns, place: str, metadata: Mapping[str, Any], config: AnalysisConfig) -> Trajectory:
    joints = columns.find(f"{_STATE}/joint_positions", JOINTS)
    if joints is None or not len(joints):
        raise DatasetError(f"it has no steps of '{_STATE}/joint_positions'")
    pose = columns.wanted(f"{_STATE}/cartesian_position", 6)
    tables, estimate_std, contact = _forces(columns, joints, config)
    action = columns.wanted(_ACTION, 6)
    if action is not None:
        tables[of.ACTION] = Table(columns=_ACTION_COLUMNS, units=("",) * 6, data=action)
    seconds, timing = _timing(columns, len(joints))
    if timing:
        names, values = zip(*timing.items(), strict=True)
        tables[of.TIMING] = Table(columns=names, units=("ms",) * len(names), data=np.stack(values, axis=1))
    skipped = columns.wanted(f"{_STAMPS}/skip_action")
    obeyed = columns.find(f"{_STATE}/prev_command_successful")
    counts = {} if skipped is None else {"skipped_actions": int(np.count_nonzero(skipped))}
    counts |= {} if obeyed is None else {"failed_commands": int(len(obeyed) - np.count_nonzero(obeyed))}
    return Trajectory(
        id=str(metadata.get("uuid") or place.removesuffix(f"/{NAME}")),
        place=place,
        labels=_labels(columns, place, metadata),
        seconds=np.arange(len(joints)) / RATE_HZ if seconds is None else seconds,
        nominal_hz=RATE_HZ,
        is_timed=seconds is not None,
        position_m=None if pose is None else pose[:, :3],
        joints_rad=joints,
        tables=tables,
        contact=contact,
        contact_by="" if contact is None else of.ESTIMATED,
        estimate_std=estimate_std,
        counts=counts,
        missing=tuple(columns.missing),
    )


def _forces(
    columns: _Columns, joints: np.ndarray, config: AnalysisConfig
) -> tuple[dict[str, Table], np.ndarray | None, np.ndarray | None]:
    """Tables of what is felt, the uncertainty of the estimate, and where it says that something is touched."""
    torque = columns.wanted(f"{_STATE}/motor_torques_measured", JOINTS)
    if torque is None:
        return {}, None, None
    tables = {of.JOINT_TORQUE: Table(columns=_NAMES, units=("N.m",) * JOINTS, data=torque)}
    found = estimate_wrench(joints, torque, round(config.tare_s * RATE_HZ), config)
    tables[of.ESTIMATED] = Table(columns=of.WRENCH_COLUMNS, units=of.WRENCH_UNITS, data=found.wrench)
    told = np.isfinite(found.touch)
    return tables, found.std, found.touch[told] > _TOUCH if told.any() else None


def _timing(columns: _Columns, steps: int) -> tuple[np.ndarray | None, dict[str, np.ndarray]]:
    """When each step began, since the first [s], and how long things took [ms]."""
    begun, ended = columns.wanted(f"{_CONTROL}/step_start"), columns.find(f"{_CONTROL}/step_end")
    read, was_read = columns.wanted(f"{_ROBOT}/read_start"), columns.find(f"{_ROBOT}/read_end")
    whole_s = columns.find(f"{_ROBOT}/robot_timestamp_seconds")
    nanos = columns.find(f"{_ROBOT}/robot_timestamp_nanos")
    latency = columns.find(f"{_STATE}/prev_controller_latency_ms")
    captures = [
        columns.find(f"{_CAMERAS}/{name}") for name in columns.names(_CAMERAS) if name.endswith("_estimated_capture")
    ]
    taken = np.stack([each for each in captures if each is not None], axis=1) if captures else None
    found: dict[str, np.ndarray] = {}
    if begun is not None:
        found["period_ms"] = np.concatenate([[np.nan], begun[1:] - begun[:-1]])
    if begun is not None and ended is not None:
        found["step_ms"] = ended - begun
    if read is not None and was_read is not None:
        found["read_ms"] = was_read - read
    if latency is not None:
        found["controller_latency_ms"] = latency
    if taken is not None and taken.shape[1] > 1:
        found["camera_skew_ms"] = taken.max(axis=1) - taken.min(axis=1)
    if taken is not None and read is not None:
        found["camera_age_ms"] = read - taken.max(axis=1)
    if read is not None and whole_s is not None and nanos is not None:
        # Both clocks' zero is their own: only how they come apart says something.
        robot_ms = (whole_s - whole_s[0]) * 1e3 + nanos * 1e-6
        apart = robot_ms - (read - read[0])
        found["robot_clock_ms"] = apart - apart[0]
    if begun is None and read is None:
        return None, found
    start = begun if begun is not None else read
    assert start is not None
    return (start - start[0]) * 1e-3, found


def _labels(columns: _Columns, place: str, metadata: Mapping[str, Any]) -> Labels:
    """From the metadata; what they do not say, from the file and from the names of folders."""
    wanted = ("current_task", "user", "scene_id", "success")
    said = dict(metadata)
    if any(name not in said for name in wanted):
        said = {**columns.attributes(), **said}
    parts = place.split("/")
    outcome = next((i for i, part in enumerate(parts[:-1]) if part in _OUTCOMES), None)
    success = said.get("success")
    if success is None and outcome is not None:
        success = _OUTCOMES[parts[outcome]]
    lab = said.get("lab") or (parts[outcome - 1] if outcome else "")
    return Labels(
        task=_text(said.get("current_task")),
        lab=_text(lab),
        collector=_text(said.get("user") or said.get("user_id")),
        scene=_text(said.get("scene_id")),
        success=None if success is None else bool(success),
    )


def _text(value: Any) -> str:
    return "" if value is None else (value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value))
