"""The rules of robomimic's HDF5, strictly: what robomimic itself asks for, and what it loads without a word.

Written from robomimic 0.3.0's own reading of such files. Files of others are held to the format's rules alone; ours
have times, scales and targets besides.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from wrenchflow.datasets.validation.members import Members
from wrenchflow.datasets.validation.problems import Problems
from wrenchflow.errors import DatasetError

_ROWS = ("actions", "rewards", "dones")
_ENV = ("env_name", "type", "env_kwargs")
_QUATERNIONS = ("ee_quat", "goal_quat", "robot0_eef_quat")


def check(path: Path) -> Problems:
    """Everything that is wrong with a file; an episode at a time.

    Raises:
        DatasetError: If it is no HDF5 file.
    """
    problems = Problems(file=path.name)
    try:
        with h5py.File(path, "r") as file:
            _check_file(file, problems)
    except (OSError, RuntimeError) as error:
        raise DatasetError(f"'{path}' cannot be read as HDF5: {error}") from error
    return problems


def _check_file(file: h5py.File, problems: Problems) -> None:
    data = file.get("data")
    if not isinstance(data, h5py.Group):
        problems.add("layout", f"there is no group /data, got {', '.join(file) or 'an empty file'}")
        return
    _check_environment(data, problems)
    names = [str(name) for name in data]
    for name in names:
        if not (name.startswith("demo_") and name.removeprefix("demo_").isdecimal()):
            problems.add("layout", "expected names of the form demo_0", episode=name)
    if not names:
        problems.add("layout", "/data holds no episode")
    members, total = Members(), 0
    shapes: dict[str, tuple[Any, ...]] = {}
    for name in sorted(names, key=lambda name: (len(name), name)):
        demo = data[name]
        if not isinstance(demo, h5py.Group):
            problems.add("layout", "is no group", episode=name)
            continue
        total += _check_demo(demo, name, data, shapes, members, problems)
    if "total" not in data.attrs:
        problems.add("layout", "attribute total is missing", column="/data")
    elif int(str(data.attrs["total"])) != total:
        problems.add("length", f"total is {data.attrs['total']}, but episodes have {total} samples", column="/data")
    members.check(_masks(file, problems), problems)


def _check_environment(data: h5py.Group, problems: Problems) -> None:
    try:
        env: Any = json.loads(str(data.attrs["env_args"]))
        lacking = [name for name in _ENV if name not in env]
        if lacking:
            problems.add("layout", f"env_args lacks {', '.join(lacking)}", column="/data")
    except KeyError:
        problems.add("layout", "attribute env_args is missing", column="/data")
    except (TypeError, ValueError) as error:
        problems.add("layout", f"env_args is not JSON: {error}", column="/data")


def _check_demo(
    demo: h5py.Group,
    name: str,
    data: h5py.Group,
    shapes: dict[str, tuple[Any, ...]],
    members: Members,
    problems: Problems,
) -> int:
    """Check an episode; how many samples it has."""
    if "num_samples" not in demo.attrs:
        problems.add("layout", "attribute num_samples is missing", episode=name)
        return 0
    count = int(str(demo.attrs["num_samples"]))
    if count < 1:
        problems.add("length", f"num_samples is {count}, expected 1 or more", episode=name)
    columns: dict[str, np.ndarray] = {}
    for column in _columns(demo):
        values: Any = demo[column]
        if values.shape[:1] != (count,):
            problems.add("length", f"has shape {values.shape}, but num_samples is {count}", episode=name, column=column)
            continue
        shape = (*values.shape[1:], str(values.dtype))
        expected = shapes.setdefault(column, shape)
        if shape != expected:
            problems.add("shape", f"has rows of {shape}, the first episode {expected}", episode=name, column=column)
        if values.ndim < 4:  # Pictures are whole numbers, and most of the bytes.
            columns[column] = values[()]
            problems.require_finite(columns[column], episode=name, column=column)
    for column in (*_ROWS, *(column for column in shapes if column not in demo)):
        if column not in demo:
            problems.add("layout", "is missing", episode=name, column=column)
    if not any(column.startswith("obs/") for column in _columns(demo)):
        problems.add("layout", "there are no observations", episode=name, column="obs")
    _check_values(columns, name, problems)
    if "wrenchflow_format" in data.attrs:
        _check_ours(columns, name, data, problems)
    content = [values for column, values in sorted(columns.items()) if column == "actions" or column.startswith("obs/")]
    members.add(name, content, str(demo.attrs.get("recording_id", "")))
    return count


def _columns(demo: h5py.Group) -> list[str]:
    """All data sets of an episode, by their path in it."""
    found: list[str] = []
    demo.visititems(lambda path, item: found.append(str(path)) if isinstance(item, h5py.Dataset) else None)
    return found


def _check_values(columns: dict[str, np.ndarray], name: str, problems: Problems) -> None:
    actions = columns.get("actions")
    if actions is not None and actions.size and np.abs(actions).max() > 1.0:
        row = int(np.argmax(np.abs(actions.reshape(len(actions), -1)).max(axis=1)))
        largest = np.abs(actions[row]).max()
        problems.add("range", f"{largest:g} is outside [-1, 1]", episode=name, column="actions", row=row)
    for column, values in columns.items():
        if column.rpartition("/")[2] in _QUATERNIONS and values.ndim == 2 and np.isfinite(values).all():
            problems.require_unit_quaternions(values, episode=name, column=column)
        now = columns.get(column.removeprefix("next_")) if column.startswith("next_obs/") else None
        follows = now is None or len(now) != len(values) or np.array_equal(values[:-1], now[1:], equal_nan=True)
        if now is not None and not follows:
            apart = (values[:-1] != now[1:]).reshape(len(values) - 1, -1).any(axis=1)
            what = "is not the observation of the step that follows"
            problems.add("time", what, episode=name, column=column, row=int(np.argmax(apart)))
    dones = columns.get("dones")
    if dones is not None and len(dones) and dones[:-1].any():
        row = int(np.argmax(dones[:-1] != 0))
        problems.add("time", "the episode is done before its last step", episode=name, column="dones", row=row)


def _check_ours(columns: dict[str, np.ndarray], name: str, data: h5py.Group, problems: Problems) -> None:
    """What our own files have besides: stamps, and targets that the actions come from."""
    from wrenchflow.datasets.increments import increments

    t = columns.get("t_ns")
    if t is None:
        problems.add("layout", "is missing", episode=name, column="t_ns")
    else:
        problems.require_increasing(t, episode=name, column="t_ns")
    wanted = ("actions", "actions_abs", "obs/ee_pos", "obs/ee_quat")
    if any(column not in columns for column in wanted) or "action_scale" not in data.attrs:
        return
    stored, targets, position, xyzw = (columns[column] for column in wanted)
    pose = np.hstack([position, xyzw[:, [3, 0, 1, 2]]]).astype(np.float32)
    scale = np.asarray(data.attrs["action_scale"], np.float32)
    if not all(np.isfinite(each).all() for each in (stored, targets, pose)):
        return
    apart = np.abs(stored * scale - increments(pose, targets.astype(np.float32))).max(axis=1)
    if (apart > 1e-5).any():
        row = int(np.argmax(apart))
        what = f"differs from what actions_abs and obs/ee_pos make, by {apart[row]:g}"
        problems.add("statistics", what, episode=name, column="actions", row=row)


def _masks(file: h5py.File, problems: Problems) -> dict[str, Sequence[str]]:
    group = file.get("mask")
    if not isinstance(group, h5py.Group):
        return {}
    found: dict[str, Sequence[str]] = {}
    for name, members in group.items():
        values = members[()] if isinstance(members, h5py.Dataset) else None
        if values is None or values.ndim != 1 or values.dtype.kind not in "SO":
            problems.add("mask", "is no list of names", column=f"mask/{name}")
            continue
        found[str(name)] = [each.decode() if isinstance(each, bytes) else str(each) for each in values]
    return found
