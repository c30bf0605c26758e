"""What a person did once, done again: the device's reports of a recording, at their times relative to the first."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from wrenchflow.collect.devices.device import GRIPPER_BUTTON, MARK_BUTTON, Reading
from wrenchflow.episode import Episode, Stream
from wrenchflow.errors import DeviceError
from wrenchflow.recording.recording import Recording

JOY, TARGET = "teleop/joy", "target_pose"


class Replay:
    """A `TeleopDevice` that plays a recording's reports, and then rests.

    The first read starts it. Where the recorded device fell silent, this one does, so a dead man's switch finds again
    what it found.
    """

    name = "replay"

    def __init__(self, joy: Stream, *, full_scale_counts: int, poses: Stream | None = None) -> None:
        """Take reports.

        Args:
            joy: Axes x y z rx ry rz as counts, then the buttons of gripper and mark.
            full_scale_counts: What an axis of that device reports at full deflection.
            poses: Where the TCP should be, T_base_tcp, for a device that said where and not how fast.

        Raises:
            DeviceError: If there are no reports, or they are no counts.
        """
        if not len(joy) or not np.isfinite(joy.data).all():
            raise DeviceError(
                f"nothing can be played again of {len(joy)} reports, expected 1 or more, of finite numbers."
            )
        if full_scale_counts < 1:
            raise DeviceError(f"a full scale of {full_scale_counts} counts is none, expected 1 or more.")
        counts = np.clip(np.rint(joy.data[:, :6]), -full_scale_counts, full_scale_counts)
        self._counts = counts.astype(np.int64)
        pressed = joy.data[:, 6:] > 0.5
        self._buttons = pressed[:, 0].astype(np.int64) << GRIPPER_BUTTON | pressed[:, 1] << MARK_BUTTON
        self._t_ns = joy.t - joy.t[0]
        self._full_scale_counts = full_scale_counts
        # The target at a report's time is not yet where that report moves it: that is told by the next.
        self._poses = None if poses is None else _at(poses, np.append(joy.t[1:], joy.t[-1] + _period_ns(joy)))
        self._end_ns = int(self._t_ns[-1]) + _period_ns(joy)
        self._start_ns: int | None = None
        self._index, self._over, self._closed = 0, False, False

    @property
    def full_scale_counts(self) -> int:
        """That of the device that was recorded."""
        return self._full_scale_counts

    @property
    def is_over(self) -> bool:
        """Whether all has been played."""
        return self._over

    def read(self, now_ns: int) -> Reading:
        """The newest report whose time has come."""
        if self._closed:
            raise DeviceError("the replay was closed, and cannot be read any more: open the recording again.")
        if self._start_ns is None:
            self._start_ns = now_ns
        since_ns = now_ns - self._start_ns
        self._over = self._over or since_ns >= self._end_ns
        if self._over:
            return Reading(t_ns=self._start_ns + int(self._t_ns[-1]))
        # A clock that goes back takes no report back.
        self._index = max(self._index, int(np.searchsorted(self._t_ns, since_ns, side="right")) - 1)
        return Reading(
            t_ns=self._start_ns + int(self._t_ns[self._index]),
            counts=self._counts[self._index].copy(),
            buttons=int(self._buttons[self._index]),
            pose=None if self._poses is None else self._poses[self._index].copy(),
        )

    def feel(self, share: float) -> None:
        """Nothing: nobody holds it."""

    def close(self) -> None:
        """Stop playing."""
        self._closed = True


def open_replay(path: Path, *, full_scale_counts: int | None = None) -> Replay:
    """Play the reports of a recording.

    Args:
        path: A finished recording of a demonstration.
        full_scale_counts: Of the device that was recorded, where the recording does not say it.

    Raises:
        RecordingError: If the file cannot be read, or holds no reports.
        DeviceError: If the full scale is not known.
    """
    recording = Recording(path)
    targets = [TARGET] if TARGET in recording.streams else []
    episode = recording.read([JOY, *targets])
    scale = full_scale_counts or _scale(episode.meta)
    if scale is None:
        raise DeviceError(f"'{path}' does not say the full scale of its device: give full_scale_counts, such as 350.")
    return Replay(episode[JOY], full_scale_counts=scale, poses=_poses(episode))


def _scale(meta: Any) -> int | None:
    for place in (("device",), ("collect", "twist_map")):
        found = meta
        for name in place:
            found = found.get(name) if isinstance(found, Mapping) else None
        scale = found.get("full_scale_counts") if isinstance(found, Mapping) else None
        if isinstance(scale, int) and scale > 0:
            return scale
    return None


def _poses(episode: Episode) -> Stream | None:
    """The targets, where a device moved them without ever reporting an axis."""
    joy, targets = episode[JOY], episode.streams.get(TARGET)
    if targets is None or joy.data[:, :6].any():
        return None
    moved = targets.between(int(joy.t[0]), int(joy.t[-1]) + 1)
    return targets if len(moved) and np.ptp(moved.data, axis=0).any() else None


def _at(poses: Stream, t: np.ndarray) -> np.ndarray:
    """The newest pose at each time, or the first."""
    return poses.data[np.maximum(np.searchsorted(poses.t, t, side="right") - 1, 0)]


def _period_ns(joy: Stream) -> int:
    return int(np.median(np.diff(joy.t))) if len(joy) > 1 else 1
