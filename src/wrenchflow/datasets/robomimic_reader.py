"""Reads a robomimic file that wrenchflow wrote, with the checks that nobody else makes on one."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from jaxtyping import Float32

from wrenchflow.datasets import increments
from wrenchflow.datasets.about import filter_said, keys_said
from wrenchflow.datasets.checks import require_values
from wrenchflow.datasets.keys import Key, from_keys
from wrenchflow.datasets.robomimic import FORMAT_VERSION
from wrenchflow.errors import DatasetError
from wrenchflow.force_filter import FilterConfig
from wrenchflow.observation import ACTION_WIDTH, Steps


def read(path: Path) -> list[Steps]:
    """Read and check a file that `robomimic.writing` made; pictures are left where they are.

    Raises:
        DatasetError: If it is missing or not HDF5, has another layout, or holds what no layout allows: values that are
            not finite, arrays of another length than `num_samples`, actions outside [-1, 1] or other than the targets
            that stand beside them.
    """
    if not path.is_file():
        raise DatasetError(f"data set '{path}' does not exist.")
    try:
        with h5py.File(path, "r") as file:
            return _read_all(file, path)
    except (OSError, RuntimeError) as error:  # h5py raises either for a damaged file.
        raise DatasetError(f"'{path}' cannot be read as HDF5: {error}") from error


def _read_all(file: h5py.File, path: Path) -> list[Steps]:
    where = f"'{path}'"
    data = file.get("data")
    if not isinstance(data, h5py.Group) or "wrenchflow_format" not in data.attrs:
        raise DatasetError(
            f"{where} is not a robomimic file of wrenchflow: expected /data with attributes wrenchflow_format, "
            f"period_ns and action_scale, got {', '.join(file) or 'an empty file'}."
        )
    version = _attribute(data, "wrenchflow_format", int, where)
    if version != FORMAT_VERSION:
        raise DatasetError(
            f"{where} has format {version}; this wrenchflow reads format {FORMAT_VERSION}: export it anew."
        )
    scale = np.asarray(data.attrs.get("action_scale", ()), np.float32)
    require_values(scale, (increments.WIDTH,), f"{where}: attribute action_scale")
    period_ns = _attribute(data, "period_ns", int, where)
    names = [str(name) for name in data]
    for name in names:
        if not (name.startswith("demo_") and name.removeprefix("demo_").isdecimal()):
            raise DatasetError(f"{where}: /data holds '{name}', expected names of the form demo_0.")
    names.sort(key=lambda name: int(name.removeprefix("demo_")))
    about = _attribute(data, "about", _json, where)
    demos = _Demos(period_ns, scale, keys_said(about, where), _streams(data, where), filter_said(about, where))
    steps = [demos.read(data[name], f"{where}: {name}") for name in names]
    if not steps:
        raise DatasetError(f"{where} holds no episode.")
    total = sum(len(one) for one in steps)
    if _attribute(data, "total", int, where) != total:
        raise DatasetError(f"{where} says total = {data.attrs['total']}, but its episodes have {total} samples.")
    masks = file.get("mask")
    for mask, members in masks.items() if isinstance(masks, h5py.Group) else ():
        for member in members[()] if isinstance(members, h5py.Dataset) else ():
            if member.decode() not in names:
                raise DatasetError(f"{where}: mask '{mask}' names '{member.decode()}', which is not in /data.")
    return steps


class _Demos:
    """Reads the demos of one file, of which this much is known."""

    def __init__(
        self,
        period_ns: int,
        scale: Float32[np.ndarray, " 6"],
        keys: tuple[Key, ...],
        streams: tuple[str, ...],
        felt: FilterConfig,
    ) -> None:
        self._period_ns, self._scale, self._keys, self._streams, self._felt = period_ns, scale, keys, streams, felt

    def read(self, demo: object, where: str) -> Steps:
        if not isinstance(demo, h5py.Group):
            raise DatasetError(f"{where} is not a group.")
        count = _attribute(demo, "num_samples", int, where)
        for name in ("rewards", "dones"):
            _array(demo, name, count, where)
        t = _array(demo, "t_ns", count, where)
        if t.dtype != np.int64 or (np.diff(t) <= 0).any():
            raise DatasetError(f"{where}: t_ns has to be int64 and to increase.")
        values: dict[str, np.ndarray] = {}
        for group in ("next_obs", "obs") if "next_obs" in demo else ("obs",):
            for key in self._keys:
                values[key.name] = _array(demo, f"{group}/{key.name}", count, where)
                require_values(values[key.name], (count, *key.shape), f"{where}: {group}/{key.name}")
        observations = from_keys(values)
        return Steps(
            episode_id=_attribute(demo, "episode_id", str, where),
            t=t,
            period_ns=self._period_ns,
            observations=observations,
            actions=self._actions(demo, count, observations["tcp_pose"], where),
            success=_attribute(demo, "success", bool, where),
            wrench_filter=self._felt,
            recording_id=_attribute(demo, "recording_id", str, where),
            task=_attribute(demo, "task", str, where),
            operator=_attribute(demo, "operator", str, where),
            skew_ns=self._by_stream(demo, "skew_ns", np.int64, count, where),
            valid={
                name: of.astype(bool) for name, of in self._by_stream(demo, "valid", np.uint8, count, where).items()
            },
        )

    def _actions(
        self, demo: h5py.Group, count: int, tcp_pose: Float32[np.ndarray, "T 7"], where: str
    ) -> Float32[np.ndarray, "T 9"]:
        stored = _array(demo, "actions", count, where)
        require_values(stored, (count, increments.WIDTH), f"{where}: actions")
        if (np.abs(stored) > 1.0).any():
            raise DatasetError(f"{where}: actions lie outside [-1, 1], up to {np.abs(stored).max():g}.")
        targets = _array(demo, "actions_abs", count, where)
        require_values(targets, (count, ACTION_WIDTH), f"{where}: actions_abs")
        apart = np.abs(stored * self._scale - increments.increments(tcp_pose, targets)).max(initial=0.0)
        if apart > 1e-5:  # [m] and [rad]; another machine's arithmetic may differ in the last bits.
            raise DatasetError(f"{where}: actions differ from what actions_abs and ee_pos make, by up to {apart:g}.")
        return targets

    def _by_stream(self, demo: h5py.Group, name: str, kind: type, count: int, where: str) -> Mapping[str, np.ndarray]:
        if not self._streams:
            return {}
        found = _array(demo, name, count, where)
        if found.shape != (count, len(self._streams)) or found.dtype != kind:
            raise DatasetError(
                f"{where}: {name} is {found.dtype} of shape {found.shape}, expected {np.dtype(kind)} of shape "
                f"({count}, {len(self._streams)}), one column a stream."
            )
        return {stream: np.ascontiguousarray(found[:, i]) for i, stream in enumerate(self._streams)}


def _streams(data: h5py.Group, where: str) -> tuple[str, ...]:
    if "sync_streams" not in data.attrs:
        return ()
    return _attribute(data, "sync_streams", lambda names: tuple(str(name) for name in names), where)


def _json(text: str) -> Mapping[str, Any]:
    found = json.loads(text)
    if not isinstance(found, Mapping):
        raise ValueError(f"{text!r} is no object")
    return found


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
