"""Writes Diffusion Policy's replay buffer: a zarr folder of format 2, an episode at a time.

Each key of `data/` holds the rows of all episodes, one after the other, and `meta/episode_ends` says where each ends.
What the format has no place for is in the attributes, as texts that zarr of any version reads.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from wrenchflow.datasets import increments, keys
from wrenchflow.datasets.about import About
from wrenchflow.datasets.keys import to_keys
from wrenchflow.datasets.masks import Member, masks_of
from wrenchflow.datasets.pictures import decode_all
from wrenchflow.datasets.sink import add_all
from wrenchflow.errors import ConfigError, DatasetError, OutputError
from wrenchflow.manifest import output_folder
from wrenchflow.observation import Steps

FORMAT_VERSION = 1
MARK = ".zattrs"
_CHUNK_BYTES = 1 << 20
# The rows of an episode that is written are held until there is this much, for each addition rewrites a chunk.
_HELD_BYTES = 32 << 20


def write(folder: Path, steps: Sequence[Steps], about: About, *, overwrite: bool = False) -> None:
    """Write episodes that are in memory; `writing` says the rest."""
    with writing(folder, about, overwrite=overwrite) as sink:
        add_all(sink, steps)


@contextmanager
def writing(folder: Path, about: About, *, overwrite: bool = False) -> Iterator["ReplayBufferSink"]:
    """Write a data set as a replay buffer; equal steps give equal bytes.

    `data/action` is the target in physical units, position and the first two columns of the rotation, as Diffusion
    Policy has absolute actions; `data/action_increment` the way there. `data/timestamp` are seconds since the first
    step of an episode, `data/time_ns` when it was.

    Args:
        folder: The folder; it is called `<folder>.partial` until the block ends well.
        about: What is known of the whole.
        overwrite: Replace a folder that is there.

    Raises:
        ConfigError: If zarr is not installed.
        DatasetError: If there was no episode.
        OutputError: If the place is taken or cannot be written to.
    """
    try:
        import zarr
    except ModuleNotFoundError as error:
        raise ConfigError("this needs zarr, which is not installed: install wrenchflow[zarr].") from error
    try:
        with output_folder(folder, overwrite=overwrite, mark=MARK) as partial:
            sink = ReplayBufferSink(zarr.open_group(str(partial), mode="a", zarr_format=2), about)
            yield sink
            sink.finish()
    except OSError as error:
        raise OutputError(f"output '{folder}' cannot be written: {error}") from error


class ReplayBufferSink:
    """Takes episodes into an open group."""

    def __init__(self, root: Any, about: About) -> None:
        self._root, self._about = root, about
        self._data, self._meta = root.create_group("data"), root.create_group("meta")
        self._first: Steps | None = None
        self._members: list[Member] = []
        self._told: list[dict[str, Any]] = []
        self._ends: list[int] = []
        self._held: dict[str, list[np.ndarray]] = {}

    def add(self, steps: Steps) -> None:
        """Write an episode."""
        self._first = self._first or steps
        for name, values in self._columns(steps).items():
            self._held.setdefault(name, []).append(values)
        self._members.append(Member.of(steps))
        told = ("episode_id", "recording_id", "task", "operator", "success")
        self._told.append({name: getattr(steps, name) for name in told})
        self._ends.append((self._ends[-1] if self._ends else 0) + len(steps))
        if sum(values.nbytes for each in self._held.values() for values in each) > _HELD_BYTES:
            self._flush()

    def finish(self) -> None:
        """Write what is known of the whole."""
        if self._first is None:
            raise DatasetError("there is no episode to export.")
        self._flush()
        _create(self._meta, "episode_ends", np.array(self._ends, np.int64))
        described = self._about.described(self._first)
        masks = {name: list(members) for name, members in masks_of(self._members, self._about).items()}
        self._root.attrs.update(
            {
                "wrenchflow_format": FORMAT_VERSION,
                **_plain(described),
                "action_columns": list(keys.ACTION_COLUMNS),
                "action_units": list(keys.ACTION_UNITS),
                "action_rule": keys.ACTION_RULE,
                "increment_columns": list(increments.COLUMNS),
                "increment_units": list(increments.UNITS),
                "increment_rule": increments.RULE,
                "quaternion_order": "xyzw",
                "masks": masks,
                "episodes": self._told,
            }
        )

    def _columns(self, steps: Steps) -> Mapping[str, np.ndarray]:
        side_px = self._about.config.image_px
        sync = {"sync_skew_ns": steps.skew_ns, "sync_valid": steps.valid} if steps.skew_ns else {}
        return {
            **to_keys(steps.observations),
            **{f"{name}_image": decode_all(of, (side_px, side_px)) for name, of in steps.pictures.items()},
            "action": steps.actions,
            "action_increment": increments.increments(steps.observations["tcp_pose"], steps.actions),
            "timestamp": (steps.t - steps.t[0]) * 1e-9,
            "time_ns": steps.t,
            **{name: np.stack(list(of.values()), axis=1) for name, of in sync.items()},
        }

    def _flush(self) -> None:
        for name, each in self._held.items():
            values = np.concatenate(each)
            if name in self._data:
                self._data[name].append(values)
            else:
                _create(self._data, name, values)
        self._held.clear()


def _create(group: Any, name: str, values: np.ndarray) -> None:
    """An array with these rows; a picture is a chunk of its own, so that one can be read alone."""
    from numcodecs import Zstd

    row_bytes = max(values[:1].nbytes, 1)
    rows = 1 if values.ndim == 4 else max(_CHUNK_BYTES // row_bytes, 1)
    array = group.create_array(
        name,
        shape=(0, *values.shape[1:]),
        chunks=(rows, *values.shape[1:]),
        dtype=values.dtype,
        compressors=Zstd(level=1),
    )
    array.append(values)


def _plain(value: Any) -> Any:
    """A value as JSON has it."""
    if isinstance(value, Mapping):
        return {name: _plain(each) for name, each in value.items()}
    return [_plain(each) for each in value] if isinstance(value, list | tuple) else value
