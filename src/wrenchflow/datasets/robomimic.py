"""Writes robomimic's HDF5, an episode at a time.

What robomimic has no place for (times, units, frames, how values were sampled, how actions were scaled) is in
attributes and in data sets of names that it ignores. Numbers lie as they are, without chunks or compression: a force
is noise in its last bits, so that gzip saves a tenth and costs four times the time to write (measured, RESULTS.md).
"""

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
from jaxtyping import Float32

from wrenchflow import __version__
from wrenchflow.datasets import increments, keys
from wrenchflow.datasets.about import About
from wrenchflow.datasets.keys import to_keys
from wrenchflow.datasets.masks import Member, masks_of
from wrenchflow.datasets.pictures import decode_all
from wrenchflow.datasets.robomimic_config import training_config
from wrenchflow.datasets.sink import add_all
from wrenchflow.errors import DatasetError, OutputError
from wrenchflow.manifest import partial_of, write_json
from wrenchflow.observation import Steps

FORMAT_VERSION = 2
_GYM = 2  # robomimic's number for an environment that is not robosuite's.
_TRANSLATION = 3  # The first columns of an increment, in [m]; the others are in [rad].


def write(path: Path, steps: Sequence[Steps], about: About, *, overwrite: bool = False) -> None:
    """Write episodes that are in memory; `writing` says the rest."""
    with writing(path, about, overwrite=overwrite) as sink:
        add_all(sink, steps)


@contextmanager
def writing(path: Path, about: About, *, overwrite: bool = False) -> Iterator["RobomimicSink"]:
    """Write a data set as robomimic's HDF5; equal steps give equal bytes.

    `actions` are pose increments, divided by `action_scale` so that they lie in [-1, 1]: a power of two for translation
    and one for rotation, so that multiplying gives them back exactly. The targets themselves are beside them, as
    `actions_abs`. Where `next_obs` is asked for, that of the last step repeats its `obs`: the episode ends there.

    A configuration that robomimic trains on it with is written beside it, as `<stem>.train.json`.

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
        with h5py.File(partial, "w") as file:
            sink = RobomimicSink(file, about)
            yield sink
            sink.finish()
        with partial.open("rb") as written:
            os.fsync(written.fileno())
        os.replace(partial, path)
        write_json(config_path(path), training_config(path.name, sink.first))
    except (OSError, RuntimeError) as error:
        # Where a disk is full, h5py says so by a RuntimeError, when it closes the file.
        if isinstance(error, RuntimeError) and "errno" not in str(error):
            raise
        raise OutputError(f"output '{path}' cannot be written: {error}") from error


def config_path(path: Path) -> Path:
    """Where the training configuration of a data set is."""
    return path.with_suffix(".train.json")


class RobomimicSink:
    """Takes episodes into an open file."""

    def __init__(self, file: h5py.File, about: About) -> None:
        self._file, self._about = file, about
        self._data = file.create_group("data")
        self._first: Steps | None = None
        self._members: list[Member] = []
        self._total = 0
        self._largest = np.zeros(increments.WIDTH, np.float32)

    def add(self, steps: Steps) -> None:
        """Write an episode as the next demo."""
        self._first = self._first or steps
        made = increments.increments(steps.observations["tcp_pose"], steps.actions)
        self._largest = np.maximum(self._largest, np.abs(made).max(axis=0))
        demo = self._data.create_group(f"demo_{len(self._members)}")
        demo.attrs["num_samples"] = len(steps)
        for name in ("episode_id", "recording_id", "task", "operator", "success"):
            demo.attrs[name] = getattr(steps, name)
        last = np.arange(len(steps)) == len(steps) - 1
        _write(demo, "actions", made)  # Scaled in `finish`, when all are known.
        _write(demo, "actions_abs", steps.actions)
        _write(demo, "rewards", (last & steps.success).astype(np.float32))
        _write(demo, "dones", last.astype(np.int64))
        _write(demo, "t_ns", steps.t)
        if steps.skew_ns:
            _write(demo, "skew_ns", np.stack(list(steps.skew_ns.values()), axis=1))
            _write(demo, "valid", np.stack(list(steps.valid.values()), axis=1).astype(np.uint8))
        following = np.minimum(np.arange(len(steps)) + 1, len(steps) - 1)
        for name, values in self._observed(steps).items():
            _write(demo, f"obs/{name}", values)
            if self._about.config.next_obs:
                _write(demo, f"next_obs/{name}", values[following])
        self._members.append(Member.of(steps))
        self._total += len(steps)

    @property
    def first(self) -> Steps:
        """The first episode.

        Raises:
            DatasetError: If there was none.
        """
        if self._first is None:
            raise DatasetError("there is no episode to export.")
        return self._first

    def finish(self) -> None:
        """Scale the actions, and write what is known of the whole."""
        first = self.first
        scale = action_scale(self._largest)
        for name, demo in self._data.items():
            made = demo["actions"][()]
            stored = made / scale
            if not np.array_equal(stored * scale, made):
                raise DatasetError(f"the actions of {name} hold numbers too small to be scaled exactly.")
            demo["actions"][...] = stored
        tasks = sorted({member.task for member in self._members})
        env_args = {"env_name": ", ".join(tasks), "type": _GYM, "env_version": __version__, "env_kwargs": {}}
        described = self._about.described(first)
        attributes = self._data.attrs
        attributes["total"] = self._total
        attributes["env_args"] = json.dumps(env_args)
        attributes["wrenchflow_format"] = FORMAT_VERSION
        attributes["about"] = json.dumps(described)
        attributes["period_ns"], attributes["rate_hz"] = described["period_ns"], described["rate_hz"]
        attributes["action_scale"] = scale
        attributes["action_columns"] = increments.COLUMNS
        attributes["action_units"] = increments.UNITS
        attributes["action_rule"] = f"{increments.RULE}; stored divided by action_scale"
        attributes["actions_abs_columns"] = keys.ACTION_COLUMNS
        attributes["actions_abs_units"] = keys.ACTION_UNITS
        attributes["actions_abs_rule"] = keys.ACTION_RULE
        attributes["quaternion_order"] = "xyzw"
        attributes["force_torque_is_causal"] = True
        if first.skew_ns:
            attributes["sync_streams"] = list(first.skew_ns)
        if self._about.config.next_obs:
            attributes["next_obs_rule"] = "obs of the next step; of the last step, its own"
        for name, members in masks_of(self._members, self._about).items():
            named = [f"demo_{i}".encode() for i in members]
            width = max((len(each) for each in named), default=1)
            _write(self._file, f"mask/{name}", np.array(named, dtype=f"S{width}"))

    def _observed(self, steps: Steps) -> dict[str, np.ndarray]:
        side_px = self._about.config.image_px
        pictures = {f"{name}_image": decode_all(of, (side_px, side_px)) for name, of in steps.pictures.items()}
        return {**to_keys(steps.observations), **pictures}


def action_scale(largest: Float32[np.ndarray, " 6"]) -> Float32[np.ndarray, " 6"]:
    """The least powers of two, one for translation and one for rotation, that increments of that size fit into."""
    scale = np.ones_like(largest)
    for part in (slice(_TRANSLATION), slice(_TRANSLATION, None)):
        fraction, exponent = np.frexp(largest[part].max())  # largest = fraction * 2^exponent, 0.5 <= fraction < 1
        if fraction:
            scale[part] = np.ldexp(np.float32(1.0), int(exponent) - (fraction == 0.5))
    return scale


def _write(group: h5py.Group, name: str, values: np.ndarray) -> None:
    # The time of writing would make equal data different bytes. A picture is read by itself, and shrinks by a third.
    packed = (
        {"chunks": (1, *values.shape[1:]), "compression": "gzip", "compression_opts": 1} if values.ndim == 4 else {}
    )
    group.create_dataset(name, data=values, track_times=False, **packed)
