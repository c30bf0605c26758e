"""Folders of our own recordings, raw or clean: the wrench was measured, at its own rate."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from wrenchflow.datasets.analysis import trajectory as of
from wrenchflow.datasets.analysis.config import AnalysisConfig
from wrenchflow.datasets.analysis.trajectory import Labels, Table, Trajectory
from wrenchflow.datasets.sample import is_success, operator_of
from wrenchflow.episode import Episode, Stream
from wrenchflow.errors import DatasetError
from wrenchflow.process.contact import CONTACT, in_contact
from wrenchflow.recording.reader import find_recordings
from wrenchflow.recording.recording import Recording

# Of these, what is there; a pose at 1 kHz says no more of a path than at this.
_STREAMS = ("joint_states", "tcp_pose", "target_pose", "wrench", "wrench_raw", "external_torque")
_PATH_HZ = 50.0
_ACTION = ("x", "y", "z", "qw", "qx", "qy", "qz")


@dataclass(frozen=True, kw_only=True)
class RecordingFolder:
    """A folder of `*.mcap`.

    Attributes:
        root: The folder.
    """

    root: Path

    kind = "recordings"

    def places(self) -> list[str]:
        """The recordings, in the order of their names."""
        return [path.name for path in find_recordings(self.root)]

    def read(self, place: str, config: AnalysisConfig) -> Trajectory:
        """Read one of them."""
        recording = Recording(self.root / place)
        there = [name for name in _STREAMS if name in recording.streams]
        if not there:
            raise DatasetError(f"it has none of {', '.join(_STREAMS)}.")
        episode = recording.read([name for name in there if name != "wrench_raw" or "wrench" not in there])
        paced = next((episode[name] for name in there if name in episode and len(episode[name])), None)
        if paced is None:
            raise DatasetError("it has no samples.")
        pose, joints = _thinned(episode, "tcp_pose"), _thinned(episode, "joint_states")
        wrench = episode.streams.get("wrench")
        return Trajectory(
            id=episode.id,
            place=place,
            labels=_labels(episode),
            seconds=(paced.t - paced.t[0]) * 1e-9,
            is_timed=True,
            position_m=None if pose is None else pose.data[:, :3],
            joints_rad=None if joints is None else joints.data[:, : joints.data.shape[1] // 3],
            tables=_tables(episode),
            contact=None if wrench is None else in_contact(wrench, episode.events_of(CONTACT)),
            contact_by="" if wrench is None else of.WRENCH,
            missing=tuple(name for name in ("tcp_pose", "joint_states", "wrench") if name not in episode),
        )


def _tables(episode: Episode) -> dict[str, Table]:
    """What it holds, each at its own rate; torques are without gravity."""
    tables = {}
    for name, stream in ((of.WRENCH, "wrench"), (of.WRENCH_RAW, "wrench_raw")):
        if stream in episode:
            tables[name] = _table(episode[stream])
    if "joint_states" in episode:
        joints = episode["joint_states"]
        third = joints.data.shape[1] // 3
        columns, units = joints.signal.columns[2 * third :], joints.signal.units[2 * third :]
        tables[of.JOINT_TORQUE] = Table(columns=columns, units=units, data=joints.data[:, 2 * third :])
    if (target := _thinned(episode, "target_pose")) is not None:
        tables[of.ACTION] = Table(columns=_ACTION, units=target.signal.units, data=target.data)
    return tables


def _table(stream: Stream) -> Table:
    return Table(columns=stream.signal.columns, units=stream.signal.units, data=stream.data)


def _thinned(episode: Episode, name: str) -> Stream | None:
    """A stream at no more than some rows a second."""
    if name not in episode or not len(episode[name]):
        return None
    stream = episode[name]
    rate_hz = stream.rate_hz
    every = max(int(rate_hz // _PATH_HZ), 1) if np.isfinite(rate_hz) else 1
    return Stream(stream.t[::every], stream.data[::every], stream.signal, stream.frame)


def _labels(episode: Episode) -> Labels:
    result = episode.meta.get("result")
    says = isinstance(result, Mapping) and "success" in result
    return Labels(task=episode.task, collector=operator_of(episode), success=is_success(episode) if says else None)
