"""A robomimic HDF5 file, ours or another's: at least `actions`, and of the observations what goes by a usual name."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from wrenchflow.datasets.analysis import names
from wrenchflow.datasets.analysis import trajectory as of
from wrenchflow.datasets.analysis.config import AnalysisConfig
from wrenchflow.datasets.analysis.touch import touching
from wrenchflow.datasets.analysis.trajectory import Labels, Table, Trajectory
from wrenchflow.errors import DatasetError

_USUAL_HZ = 20.0  # Of robosuite's controllers, for want of anything said: how many steps the tare takes.


@dataclass(frozen=True, kw_only=True)
class RobomimicFile:
    """A file.

    Attributes:
        path: Where it is.
    """

    path: Path

    kind = "robomimic HDF5"

    def places(self) -> list[str]:
        """Its demos, by number."""
        try:
            with h5py.File(self.path, "r") as file:
                data = file.get("data")
                if not isinstance(data, h5py.Group):
                    raise DatasetError(f"'{self.path}' holds no /data, expected robomimic's layout.")
                return sorted((str(name) for name in data), key=_number)
        except (OSError, RuntimeError) as error:
            raise DatasetError(f"'{self.path}' cannot be read as HDF5: {error}") from error

    def read(self, place: str, config: AnalysisConfig) -> Trajectory:
        """Read one demo."""
        try:
            with h5py.File(self.path, "r") as file:
                demo = file[f"data/{place}"]
                if not isinstance(demo, h5py.Group):
                    raise DatasetError("it is not a group.")
                return _trajectory(demo, place, _about(file["data"]), config)
        except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
            raise DatasetError(f"it cannot be read: {error}") from error


def _about(data: Any) -> Mapping[str, Any]:
    """What the file says of all: its rate, its task and its actions."""
    attributes: dict[str, Any] = dict(data.attrs)
    try:
        env = json.loads(attributes.get("env_args", "{}"))
    except (TypeError, ValueError):
        env = {}
    env = env if isinstance(env, Mapping) else {}
    kwargs = env.get("env_kwargs")
    rate_hz = kwargs.get("control_freq") if isinstance(kwargs, Mapping) else None
    if "period_ns" in attributes:
        rate_hz = 1e9 / float(attributes["period_ns"])
    return {
        "rate_hz": float(rate_hz) if rate_hz else None,
        "task": str(env.get("env_name", "")),
        "columns": [str(name) for name in attributes.get("action_columns", ())],
    }


def _number(name: str) -> tuple[int, str]:
    digits = name.rpartition("_")[2]
    return (int(digits) if digits.isdecimal() else 0, name)


def _trajectory(demo: h5py.Group, place: str, about: Mapping[str, Any], config: AnalysisConfig) -> Trajectory:
    actions = _rows(demo, "actions")
    if actions is None or not len(actions):
        raise DatasetError(f"it has no actions, only {', '.join(demo) or 'nothing'}.")
    steps, rate_hz = len(actions), about["rate_hz"]
    obs = demo["obs"] if isinstance(demo.get("obs"), h5py.Group) else {}
    position = _observed(obs, names.POSITIONS, steps)
    joints = _observed(obs, names.JOINTS, steps)
    columns = about["columns"]
    if len(columns) != actions.shape[1]:
        columns = [f"a{i + 1}" for i in range(actions.shape[1])]
    tables = {of.ACTION: Table(columns=tuple(columns), units=("",) * len(columns), data=actions)}
    wrench = _wrench(obs, steps)
    contact = None
    if wrench is not None:
        tables[of.WRENCH] = Table(columns=of.WRENCH_COLUMNS, units=of.WRENCH_UNITS, data=wrench)
        contact = touching(wrench[:, :3], round(config.tare_s * (rate_hz or _USUAL_HZ)))
    torque = _observed(obs, names.TORQUES, steps)
    if torque is not None:
        tables[of.JOINT_TORQUE] = _numbered("tau", "N.m", torque)
    stamps = _rows(demo, "t_ns") if "t_ns" in demo else None
    seconds = (stamps[:, 0] - stamps[0, 0]) * 1e-9 if stamps is not None and len(stamps) else None
    if seconds is None and rate_hz:
        seconds = np.arange(steps) / rate_hz
    looked_for = {"position": position, "joint angles": joints, "force": wrench, "time stamps": stamps}
    return Trajectory(
        id=str(demo.attrs.get("episode_id", place)),
        place=place,
        labels=_labels(demo, about),
        seconds=seconds,
        nominal_hz=rate_hz,
        is_timed=stamps is not None,
        position_m=None if position is None else position[:, :3],
        joints_rad=joints,
        tables=tables,
        contact=contact,
        contact_by="" if contact is None else of.WRENCH,
        missing=tuple(name for name, found in looked_for.items() if found is None),
    )


def _rows(group: Any, name: str) -> np.ndarray | None:
    """A data set as float64 of shape (T, d); None where it is none, or not of numbers."""
    found = group.get(name)
    if not isinstance(found, h5py.Dataset) or found.dtype.kind not in "fiub" or not 1 <= found.ndim <= 2:
        return None
    values = found[()].astype(np.float64)
    return values if values.ndim == 2 else values[:, None]


def _observed(obs: Any, wanted: tuple[str, ...], steps: int) -> np.ndarray | None:
    name = next((name for name in wanted if name in obs), None)
    found = None if name is None else _rows(obs, name)
    if found is not None and len(found) != steps:
        raise DatasetError(f"obs/{name} has {len(found)} rows, actions {steps}.")
    return found


def _wrench(obs: Any, steps: int) -> np.ndarray | None:
    whole = _observed(obs, names.WRENCHES, steps)
    if whole is not None:
        return whole if whole.shape[1] == 6 else None
    force, moment = _observed(obs, names.FORCES, steps), _observed(obs, names.MOMENTS, steps)
    if force is None or force.shape[1] != 3:
        return None
    return np.hstack([force, moment if moment is not None and moment.shape[1] == 3 else np.full_like(force, np.nan)])


def _numbered(name: str, unit: str, data: np.ndarray) -> Table:
    width = data.shape[1]
    return Table(columns=tuple(f"{name}{i + 1}" for i in range(width)), units=(unit,) * width, data=data)


def _labels(demo: h5py.Group, about: Mapping[str, Any]) -> Labels:
    said = {name: value for name, value in demo.attrs.items()}
    success = names.first(said, names.OUTCOMES)
    if success is None and (rewards := _rows(demo, "rewards")) is not None and len(rewards):
        success = bool(rewards.max() > 0.0)  # robomimic's own sign of a success.
    return Labels(
        task=str(names.first(said, names.TASKS) or about["task"]),
        lab=str(names.first(said, names.LABS) or ""),
        collector=str(names.first(said, names.COLLECTORS) or ""),
        scene=str(names.first(said, names.SCENES) or ""),
        success=None if success is None else bool(success),
    )
