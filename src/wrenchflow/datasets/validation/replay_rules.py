"""The rules of Diffusion Policy's replay buffer: arrays as long as the last episode's end, and finite."""

from pathlib import Path
from typing import Any

import numpy as np

from wrenchflow.datasets.validation.members import Members
from wrenchflow.datasets.validation.problems import Problems
from wrenchflow.errors import ConfigError, DatasetError


def check(path: Path) -> Problems:
    """Everything that is wrong with a folder; an episode at a time.

    Raises:
        ConfigError: If zarr is not installed.
        DatasetError: If it cannot be read as zarr.
    """
    try:
        import zarr
    except ModuleNotFoundError as error:
        raise ConfigError("this needs zarr, which is not installed: install wrenchflow[zarr].") from error
    problems = Problems(file=path.name)
    try:
        root: Any = zarr.open_group(str(path), mode="r")
        _check(root, problems)
    except (OSError, ValueError, KeyError, TypeError, RuntimeError) as error:
        raise DatasetError(f"'{path}' cannot be read as a replay buffer: {error}") from error
    return problems


def _check(root: Any, problems: Problems) -> None:
    for name in ("data", "meta"):
        if name not in root:
            problems.add("layout", f"there is no group {name}/")
    if "data" not in root or "meta" not in root or "episode_ends" not in root["meta"]:
        problems.add("layout", "is missing", column="meta/episode_ends")
        return
    ends = root["meta"]["episode_ends"][:]
    problems.require_increasing(np.concatenate([[0], ends]), episode="", column="meta/episode_ends")
    arrays = dict(root["data"].arrays())
    if "action" not in arrays:
        problems.add("layout", "is missing", column="data/action")
    for name, array in arrays.items():
        if array.shape[0] != (ends[-1] if len(ends) else 0):
            what = f"has {array.shape[0]} rows, the episodes end at {ends[-1] if len(ends) else 0}"
            problems.add("length", what, column=f"data/{name}")
    told = root.attrs.get("episodes", [])
    members = Members()
    for i, (start, stop) in enumerate(zip([0, *ends[:-1]], ends, strict=True)):
        name = f"episode {i}"
        content = []
        for key, array in sorted(arrays.items()):
            if array.ndim >= 4:
                continue
            values = np.asarray(array[int(start) : int(stop)])
            problems.require_finite(values, episode=name, column=f"data/{key}")
            if key in ("timestamp", "time_ns"):
                problems.require_increasing(values, episode=name, column=f"data/{key}")
            elif not key.startswith("sync_"):
                content.append(values)
        members.add(name, content, str(told[i].get("recording_id", "")) if i < len(told) else "")
    masks = root.attrs.get("masks", {})
    members.check({name: [f"episode {i}" for i in of] for name, of in masks.items()}, problems)
