"""What the stamps of a stream allow: even or not, where samples are missing, and which pose was known when."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.episode import Stream
from wrenchflow.errors import StreamError
from wrenchflow.signals import FORCE, WRENCH

# A step between samples that is longer than this many periods means that samples are missing.
GAP_PERIODS = 1.5
# A stream is even when its median step is this near to the nominal period, and at most this share of its steps is
# further from it than a quarter of a period. A wrong rate moves the filter's cutoff in proportion; jitter of a quarter
# of a millisecond on a force that 40 Hz lets through is an error of a few per cent of its change.
MEDIAN_TOLERANCE = 0.02
STEP_TOLERANCE = 0.25
UNEVEN_SHARE = 0.05


def check_raw(wrench_raw: Stream) -> None:
    """Refuse what is no raw wrench or force of a sensor.

    Raises:
        StreamError: If it measures something else, or is not in the sensor frame.
    """
    if wrench_raw.signal not in (WRENCH, FORCE):
        raise StreamError(f"stream 'wrench_raw' must be a wrench or a force, got a '{wrench_raw.signal.kind}'.")
    if wrench_raw.frame != "sensor":
        raise StreamError(f"stream 'wrench_raw' must be in the frame 'sensor', got '{wrench_raw.frame}'.")


def check_even(stream: Stream, rate_hz: float, name: str) -> None:
    """Refuse a stream that is not sampled evenly at its nominal rate: a filter designed for that rate would be wrong.

    Raises:
        StreamError: If the median step is off the nominal period, or too many steps are. A few missing samples pass.
    """
    if len(stream) < 2:
        raise StreamError(f"stream '{name}' has {len(stream)} samples, expected 2 at least.")
    steps = np.diff(stream.t) * (rate_hz * 1e-9)
    uneven = float((np.abs(steps - 1.0) > STEP_TOLERANCE).mean())
    if abs(np.median(steps) - 1.0) > MEDIAN_TOLERANCE or uneven > UNEVEN_SHARE:
        low_ms, median_ms, high_ms = np.percentile(np.diff(stream.t) * 1e-6, [0, 50, 100])
        raise StreamError(
            f"stream '{name}' is unevenly sampled: got steps of {low_ms:.3g} to {high_ms:.3g} ms, median "
            f"{median_ms:.3g} ms (mean rate {stream.rate_hz:.4g} Hz), {100 * uneven:.1f} % of them off; expected "
            f"{1e3 / rate_hz:.3g} ms ({rate_hz:g} Hz), median within {100 * MEDIAN_TOLERANCE:g} %, and at most "
            f"{100 * UNEVEN_SHARE:g} % of steps off by more than {100 * STEP_TOLERANCE:g} %."
        )


def finite(stream: Stream) -> Stream:
    """The samples whose values are all finite."""
    keep = np.isfinite(stream.data).all(axis=1)
    return stream if keep.all() else replace(stream, t=stream.t[keep], data=stream.data[keep])


def segments(t: Int64[np.ndarray, " n"], rate_hz: float) -> list[slice]:
    """The runs of samples between gaps."""
    breaks = np.flatnonzero(np.diff(t) > GAP_PERIODS * 1e9 / rate_hz) + 1
    edges = [0, *breaks.tolist(), len(t)]
    return [slice(first, last) for first, last in pairwise(edges) if last > first]


def held_pose(tcp_pose: Stream, t: Int64[np.ndarray, " n"]) -> tuple[int, Float[np.ndarray, "m 7"]]:
    """The last pose at or before each stamp, as a running robot knows it.

    Returns:
        How many leading stamps come before the first pose, and the poses of the others. Shape (n - that, 7).

    Raises:
        StreamError: If one of these poses has no unit quaternion.
    """
    last = np.searchsorted(tcp_pose.t, t, side="right") - 1
    before = int(np.searchsorted(last, 0))
    pose = tcp_pose.data[last[before:]]
    length = np.linalg.norm(pose[:, 3:], axis=1)
    good = np.abs(length - 1.0) < 1e-3  # False for NaN, which is no pose either.
    if not good.all():
        row = int(np.argmin(good))
        raise StreamError(
            f"stream 'tcp_pose' holds no unit quaternion for {t[before + row]} ns: got length {length[row]:.4g}, "
            "expected 1."
        )
    return before, pose
