"""Steps to and from robomimic's HDF5, and the checks that nobody else makes on such a file.

What robomimic has no place for (times, units, frames, how actions were scaled) is in attributes, which it ignores.
"""

import json
import os
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from jaxtyping import Float32

from wrenchflow import __version__
from wrenchflow.config import from_mapping, to_mapping
from wrenchflow.datasets.checks import require_exportable, require_values
from wrenchflow.datasets.grid import rate_of
from wrenchflow.datasets.keys import ACTION_COLUMNS, ACTION_RULE, ACTION_UNITS, KEYS, About, Key, from_keys, to_keys
from wrenchflow.datasets.split import validation_ids
from wrenchflow.errors import ConfigError, DatasetError, OutputError
from wrenchflow.force_filter import FilterConfig
from wrenchflow.observation import ACTION_WIDTH, Steps

FORMAT_VERSION = 1
_GYM = 2  # robomimic's number for an environment that is not robosuite's.


def write(
    path: Path, steps: Sequence[Steps], about: About, *, valid_fraction: float = 0.1, overwrite: bool = False
) -> None:
    """Write a data set as robomimic's HDF5; equal steps give equal bytes.

    Actions are divided by `action_scale`, a power of two a column, so that they lie in [-1, 1] and multiplying gives
    them back exactly. The last step's `next_obs` repeats its `obs`: the episode ends there.

    Args:
        path: The file; it is called `<path>.partial` until it is whole.
        steps: One entry an episode.
        about: What is known of the whole.
        valid_fraction: Share of the episodes that `/mask/valid` names.
        overwrite: Replace a file that is there.

    Raises:
        DatasetError: If the steps cannot make one data set.
        OutputError: If the path is taken or cannot be written.
    """
    require_exportable(steps)
    if path.exists() and not overwrite:
        raise OutputError(f"output '{path}' exists already. Choose another place, or pass --overwrite.")
    partial = path.with_name(path.name + ".partial")
    try:
        partial.parent.mkdir(parents=True, exist_ok=True)
        with h5py.File(partial, "w") as file:
            _write_all(file, steps, about, valid_fraction)
        with partial.open("rb") as written:
            os.fsync(written.fileno())
        os.replace(partial, path)
    except OSError as error:
        raise OutputError(f"output '{path}' cannot be written: {error}") from error


def read(path: Path) -> list[Steps]:
    """Read and check a file that `write` made.

    Raises:
        DatasetError: If it is missing or not HDF5, has another layout, or holds what no layout allows: values that are
            not finite, arrays of another length than `num_samples`, actions outside [-1, 1].
    """
    if not path.is_file():
        raise DatasetError(f"data set '{path}' does not exist.")
    try:
        with h5py.File(path, "r") as file:
            return _read_all(file, path)
    except (OSError, RuntimeError) as error:  # h5py raises either for a damaged file.
        raise DatasetError(f"'{path}' cannot be read as HDF5: {error}") from error


def action_scale(steps: Sequence[Steps]) -> Float32[np.ndarray, " 9"]:
    """The least power of two a column, 1 or more, that brings all actions into [-1, 1]."""
    largest = np.max([np.abs(one.actions).max(axis=0) for one in steps], axis=0)
    fraction, exponent = np.frexp(largest)  # largest = fraction * 2^exponent, with 0.5 <= fraction < 1
    return np.ldexp(np.float32(1.0), np.maximum(exponent - (fraction == 0.5), 0)).astype(np.float32)


def _write_all(file: h5py.File, steps: Sequence[Steps], about: About, valid_fraction: float) -> None:
    scale = action_scale(steps)
    rate_hz = rate_of(steps[0].period_ns)
    data = file.create_group("data")
    data.attrs["total"] = sum(len(one) for one in steps)
    data.attrs["env_args"] = json.dumps(
        {"env_name": about.task, "type": _GYM, "env_version": __version__, "env_kwargs": {}}
    )
    data.attrs["wrenchflow_format"] = FORMAT_VERSION
    data.attrs["task"] = about.task
    data.attrs["period_ns"] = steps[0].period_ns
    data.attrs["rate_hz"] = f"{rate_hz.numerator}/{rate_hz.denominator}"
    data.attrs["wrench_stage"] = about.wrench_stage
    if about.wrench_group_delay_s is not None:
        data.attrs["wrench_group_delay_s"] = about.wrench_group_delay_s
    data.attrs["wrench_filter"] = json.dumps(to_mapping(steps[0].wrench_filter))
    data.attrs["action_scale"] = scale
    data.attrs["action_columns"] = ACTION_COLUMNS
    data.attrs["action_units"] = ACTION_UNITS
    data.attrs["action_rule"] = f"{ACTION_RULE}; stored divided by action_scale"
    data.attrs["obs_keys"] = json.dumps({key.name: _described(key) for key in KEYS})
    data.attrs["next_obs_rule"] = "obs of the next step; of the last step, its own"
    for i, one in enumerate(steps):
        _write_demo(data.create_group(f"demo_{i}"), one, scale)
    valid = validation_ids([one.episode_id for one in steps], valid_fraction)
    for name, is_member in (("train", lambda id: id not in valid), ("valid", lambda id: id in valid)):
        members = [f"demo_{i}".encode() for i, one in enumerate(steps) if is_member(one.episode_id)]
        width = max((len(member) for member in members), default=1)
        _write_array(file, f"mask/{name}", np.array(members, dtype=f"S{width}"))


def _described(key: Key) -> dict[str, Any]:
    return {"columns": key.columns, "units": key.units, "frame": key.frame, "rule": key.rule}


def _write_demo(demo: h5py.Group, steps: Steps, scale: Float32[np.ndarray, " 9"]) -> None:
    demo.attrs["num_samples"] = len(steps)
    demo.attrs["episode_id"] = steps.episode_id
    demo.attrs["success"] = steps.success
    stored = steps.actions / scale
    if not np.array_equal(stored * scale, steps.actions):
        raise DatasetError(f"the actions of episode {steps.episode_id} hold numbers too small to be scaled exactly.")
    last = np.arange(len(steps)) == len(steps) - 1
    _write_array(demo, "actions", stored)
    _write_array(demo, "rewards", (last & steps.success).astype(np.float32))
    _write_array(demo, "dones", last.astype(np.int64))
    _write_array(demo, "t_ns", steps.t)
    following = np.minimum(np.arange(len(steps)) + 1, len(steps) - 1)
    values = to_keys(steps.observations)
    for key in KEYS:
        for group, rows in (("obs", values[key.name]), ("next_obs", values[key.name][following])):
            _write_array(demo, f"{group}/{key.name}", rows)


def _write_array(group: h5py.Group, name: str, values: np.ndarray) -> None:
    # The time of writing would make equal data different bytes.
    group.create_dataset(name, data=values, track_times=False)


def _read_all(file: h5py.File, path: Path) -> list[Steps]:
    where = f"'{path}'"
    data = file.get("data")
    if not isinstance(data, h5py.Group) or "wrenchflow_format" not in data.attrs:
        raise DatasetError(
            f"{where} is not a robomimic file of wrenchflow: expected /data with attributes wrenchflow_format, "
            f"period_ns and action_scale, got {', '.join(file) or 'an empty file'}."
        )
    version = _attribute(data, "wrenchflow_format", int, where)
    if version > FORMAT_VERSION:
        raise DatasetError(f"{where} has format {version}; this wrenchflow reads formats up to {FORMAT_VERSION}.")
    scale = np.asarray(data.attrs.get("action_scale", ()), np.float32)
    require_values(scale, (ACTION_WIDTH,), f"{where}: attribute action_scale")
    period_ns = _attribute(data, "period_ns", int, where)
    names = [str(name) for name in data]
    for name in names:
        if not (name.startswith("demo_") and name.removeprefix("demo_").isdecimal()):
            raise DatasetError(f"{where}: /data holds '{name}', expected names of the form demo_0.")
    names.sort(key=lambda name: int(name.removeprefix("demo_")))
    felt = _read_filter(data, where)
    steps = [_read_demo(data[name], scale, period_ns, f"{where}: {name}") for name in names]
    steps = [replace(one, wrench_filter=felt) for one in steps]
    if not steps:
        raise DatasetError(f"{where} holds no episode.")
    total = sum(len(one) for one in steps)
    if _attribute(data, "total", int, where) != total:
        raise DatasetError(f"{where} says total = {data.attrs['total']}, but its episodes have {total} samples.")
    for mask in ("train", "valid"):
        members = file.get(f"mask/{mask}")
        for member in members[()] if isinstance(members, h5py.Dataset) else ():
            if member.decode() not in names:
                raise DatasetError(f"{where}: mask '{mask}' names '{member.decode()}', which is not in /data.")
    return steps


def _read_filter(data: h5py.Group, where: str) -> FilterConfig:
    if "wrench_filter" not in data.attrs:  # As it was before it could be set.
        return FilterConfig()
    try:
        return from_mapping(FilterConfig, json.loads(_attribute(data, "wrench_filter", str, where)), "wrench_filter")
    except (ValueError, ConfigError) as error:
        raise DatasetError(f"{where}: attribute 'wrench_filter' describes no filter: {error}") from error


def _read_demo(demo: object, scale: Float32[np.ndarray, " 9"], period_ns: int, where: str) -> Steps:
    if not isinstance(demo, h5py.Group):
        raise DatasetError(f"{where} is not a group.")
    count = _attribute(demo, "num_samples", int, where)
    for name in ("rewards", "dones"):
        _array(demo, name, count, where)
    t = _array(demo, "t_ns", count, where)
    if t.dtype != np.int64 or (np.diff(t) != period_ns).any():
        raise DatasetError(f"{where}: t_ns has to be int64 with a step every {period_ns} ns.")
    stored = _array(demo, "actions", count, where)
    require_values(stored, (count, ACTION_WIDTH), f"{where}: actions")
    if (np.abs(stored) > 1.0).any():
        raise DatasetError(f"{where}: actions lie outside [-1, 1], up to {np.abs(stored).max():g}.")
    values: dict[str, np.ndarray] = {}
    for group in ("next_obs", "obs"):
        for key in KEYS:
            values[key.name] = _array(demo, f"{group}/{key.name}", count, where)
            require_values(values[key.name], (count, *key.shape), f"{where}: {group}/{key.name}")
    return Steps(
        episode_id=_attribute(demo, "episode_id", str, where),
        t=t,
        period_ns=period_ns,
        observations=from_keys(values),
        actions=stored * scale,
        success=_attribute(demo, "success", bool, where),
    )


def _attribute[T](group: h5py.Group, name: str, kind: Callable[[Any], T], where: str) -> T:
    if name not in group.attrs:
        raise DatasetError(f"{where}: attribute '{name}' is missing. It has: {', '.join(group.attrs) or 'none'}.")
    try:
        return kind(group.attrs[name])
    except (TypeError, ValueError) as error:
        raise DatasetError(f"{where}: attribute '{name}' cannot be {group.attrs[name]!r}.") from error


def _array(group: h5py.Group, name: str, count: int, where: str) -> np.ndarray:
    found = group.get(name)
    if not isinstance(found, h5py.Dataset):
        parent = group.get(name.rpartition("/")[0] or "/") if "/" in name else group
        available = sorted(parent) if isinstance(parent, h5py.Group) else ()
        raise DatasetError(f"{where}: '{name}' is missing. There is: {', '.join(available) or 'nothing'}.")
    if found.shape[:1] != (count,):
        raise DatasetError(f"{where}: num_samples is {count}, but '{name}' has shape {found.shape}.")
    return found[()]
