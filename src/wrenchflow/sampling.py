"""A stream's values at given times: between samples, held, or over a window. A gap is refused, never bridged.

Each value is made from its own samples alone, so one time asked of the last samples of a running robot gives the same
bits as many times asked of the whole recording.
"""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float, Int64

from wrenchflow.episode import Stream
from wrenchflow.errors import DatasetError
from wrenchflow.filtering import window_mean
from wrenchflow.signals import Signal
from wrenchflow.spatial import interpolate_pose

# The longest time between two samples that a value may rest on: twenty lost ticks at 1 kHz.
MAX_GAP_NS = 20_000_000


def take(streams: Mapping[str, Stream], name: str, signal: Signal) -> Stream:
    """The stream of that name, if it measures `signal`.

    Raises:
        DatasetError: If it is not there, has no samples, or measures something else.
    """
    if name not in streams:
        raise DatasetError(f"stream '{name}' is missing. There is: {', '.join(sorted(streams)) or 'none'}.")
    stream = streams[name]
    if stream.signal != signal:
        raise DatasetError(
            f"stream '{name}' has columns {' '.join(stream.signal.columns)}, expected {' '.join(signal.columns)}."
        )
    if not len(stream):
        raise DatasetError(f"stream '{name}' has no samples.")
    return stream


def at_or_before(stream: Stream, t_ns: Int64[np.ndarray, " T"], name: str) -> Int64[np.ndarray, " T"]:
    """Row of the last sample at or before each time.

    Raises:
        DatasetError: If a time lies before the first sample.
    """
    row = np.searchsorted(stream.t, t_ns, side="right") - 1
    if (row < 0).any():
        raise DatasetError(f"stream '{name}' starts at {stream.t[0]} ns, after the step at {t_ns[row < 0][0]} ns.")
    return row


def refuse_stale(stream: Stream, row: Int64[np.ndarray, " T"], t_ns: Int64[np.ndarray, " T"], name: str) -> None:
    """Refuse a time whose sample, number `row`, is older than `MAX_GAP_NS`."""
    _refuse(t_ns - stream.t[row] > MAX_GAP_NS, stream.t[row], t_ns, t_ns, name)


def refuse_gaps(
    stream: Stream,
    first: Int64[np.ndarray, " T"],
    last: Int64[np.ndarray, " T"],
    t_ns: Int64[np.ndarray, " T"],
    name: str,
) -> None:
    """Refuse a time whose samples, rows `first` to `last`, are anywhere more than `MAX_GAP_NS` apart."""
    before_gap = np.flatnonzero(np.diff(stream.t) > MAX_GAP_NS)
    following = np.searchsorted(before_gap, first)
    bad = following < np.searchsorted(before_gap, last)
    if bad.any():
        gap = before_gap[np.where(bad, following, 0)]
        _refuse(bad, stream.t[gap], stream.t[gap + 1], t_ns, name)


def crosses_gap(stream: Stream, t_ns: Int64[np.ndarray, " T"], reach_ns: int) -> Bool[np.ndarray, " T"]:
    """Whether what a time rests on is apart by more than `MAX_GAP_NS` anywhere.

    Args:
        stream: A stream that has begun at the first time, and goes on to the last one.
        t_ns: Times [ns]. Shape (T,).
        reach_ns: How far back a value looks from its time; 0 for one that needs its neighbours only.
    """
    first = np.maximum(np.searchsorted(stream.t, t_ns - reach_ns, side="right") - 1, 0)
    last = np.minimum(np.searchsorted(stream.t, t_ns, side="left"), len(stream) - 1)
    before_gap = np.flatnonzero(np.diff(stream.t) > MAX_GAP_NS)
    return np.searchsorted(before_gap, first) < np.searchsorted(before_gap, last)


def age_ns(t_sample: Int64[np.ndarray, " n"], t_ns: Int64[np.ndarray, " T"]) -> Int64[np.ndarray, " T"]:
    """How long before each time the last sample was taken [ns]; there has to be one."""
    return t_ns - t_sample[np.searchsorted(t_sample, t_ns, side="right") - 1]


def refuse_non_poses(pose: Float[np.ndarray, "T 7"], t_ns: Int64[np.ndarray, " T"], name: str) -> None:
    """Refuse a pose that is not finite, or whose quaternion is not of length 1."""
    with np.errstate(over="ignore", invalid="ignore"):
        length = np.linalg.norm(pose[:, 3:], axis=1)
        good = np.isfinite(pose).all(axis=1) & (np.abs(length - 1.0) < 1e-3)
    if not good.all():
        k = int(np.argmin(good))
        raise DatasetError(
            f"stream '{name}' has no pose for the step at {t_ns[k]} ns: expected finite numbers and a unit quaternion, "
            f"got {' '.join(f'{value:g}' for value in pose[k])}."
        )


def _refuse(
    bad: Bool[np.ndarray, " T"],
    start_ns: Int64[np.ndarray, " T"],
    stop_ns: Int64[np.ndarray, " T"],
    t_ns: Int64[np.ndarray, " T"],
    name: str,
) -> None:
    if bad.any():
        k = int(np.argmax(bad))
        raise DatasetError(
            f"stream '{name}' has no sample for {(stop_ns[k] - start_ns[k]) * 1e-6:.1f} ms after {start_ns[k]} ns, "
            f"which the step at {t_ns[k]} ns needs; the limit is {MAX_GAP_NS * 1e-6:g} ms."
        )


def _neighbours(
    stream: Stream, t_ns: Int64[np.ndarray, " T"], name: str
) -> tuple[Int64[np.ndarray, " T"], Int64[np.ndarray, " T"], Float[np.ndarray, " T"]]:
    """Rows of the samples around each time, and the second one's weight; on a stamp both are that sample."""
    before = at_or_before(stream, t_ns, name)
    after = np.where(stream.t[before] == t_ns, before, before + 1)
    if (after == len(stream)).any():
        late = t_ns[after == len(stream)][0]
        raise DatasetError(f"stream '{name}' ends at {stream.t[-1]} ns, before the step at {late} ns.")
    refuse_gaps(stream, before, after, t_ns, name)
    apart_ns = np.maximum(stream.t[after] - stream.t[before], 1)
    return before, after, (t_ns - stream.t[before]) / apart_ns


def linear(stream: Stream, t_ns: Int64[np.ndarray, " T"], name: str) -> Float[np.ndarray, "T d"]:
    """On the line between the two nearest samples; on a stamp the sample itself, bit for bit."""
    before, after, weight = _neighbours(stream, t_ns, name)
    start, stop = stream.data[before], stream.data[after]
    with np.errstate(
        over="ignore", invalid="ignore"
    ):  # What is not finite is refused once, where all observations meet.
        between = start + weight[:, None] * (stop - start)
    return np.where((before == after)[:, None], start, between)


def pose(stream: Stream, t_ns: Int64[np.ndarray, " T"], name: str) -> Float[np.ndarray, "T 7"]:
    """Between the two nearest poses, by line and by slerp; on a stamp the sample itself, bit for bit."""
    before, after, weight = _neighbours(stream, t_ns, name)
    start, stop = stream.data[before], stream.data[after]
    refuse_non_poses(start, t_ns, name)
    refuse_non_poses(stop, t_ns, name)
    return interpolate_pose(start, stop, weight)


def held(stream: Stream, t_ns: Int64[np.ndarray, " T"], name: str) -> Float[np.ndarray, "T d"]:
    """The last sample at or before each time, however old: for what is said on change."""
    return stream.data[at_or_before(stream, t_ns, name)]


def latest(stream: Stream, t_ns: Int64[np.ndarray, " T"], name: str) -> Float[np.ndarray, "T d"]:
    """The last sample at or before each time, not older than `MAX_GAP_NS`: for what is sampled at a rate."""
    row = at_or_before(stream, t_ns, name)
    refuse_stale(stream, row, t_ns, name)
    return stream.data[row]


def mean(stream: Stream, t_ns: Int64[np.ndarray, " T"], name: str, window_ns: int) -> Float[np.ndarray, "T d"]:
    """Mean of the samples in (t - window, t]; where the stream starts within the window, of those from its start."""
    last = at_or_before(stream, t_ns, name)
    refuse_stale(stream, last, t_ns, name)
    # The sample before the window counts, so that a gap across the window's start does not go unseen.
    first = np.maximum(np.searchsorted(stream.t, t_ns - window_ns, side="right") - 1, 0)
    refuse_gaps(stream, first, last, t_ns, name)
    return window_mean(stream.t, stream.data, t_ns, window_ns)


def window(
    stream: Stream, t_ns: Int64[np.ndarray, " T"], name: str, length: int, reach_ns: int
) -> Float[np.ndarray, "T {length} d"]:
    """The last `length` samples at or before each time, oldest first, none older than `reach_ns`.

    Where the stream has only just started, its first sample fills the front.

    Raises:
        DatasetError: If a running stream has fewer samples than that within `reach_ns`: it is too slow.
    """
    last = at_or_before(stream, t_ns, name)
    refuse_stale(stream, last, t_ns, name)
    oldest = np.searchsorted(stream.t, t_ns - reach_ns, side="right")
    short = (oldest > 0) & (last - oldest + 1 < length)
    if short.any():
        k = int(np.argmax(short))
        raise DatasetError(
            f"stream '{name}' has {last[k] - oldest[k] + 1} samples in the {reach_ns * 1e-6:g} ms up to the step at "
            f"{t_ns[k]} ns, expected {length} or more."
        )
    first = np.maximum(last - length + 1, 0)
    refuse_gaps(stream, first, last, t_ns, name)
    return stream.data[np.maximum(last[:, None] + np.arange(1 - length, 1), first[:, None])]
