"""Raw wrench streams to clean ones: `wrench`, which policies get, and `wrench_zero_phase`, for labels and plots."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from wrenchflow import filtering
from wrenchflow.episode import Stream
from wrenchflow.force_filter import FilterConfig
from wrenchflow.process.calibration import Bias
from wrenchflow.process.compensation import WrenchPipeline
from wrenchflow.process.config import InertiaConfig
from wrenchflow.process.inertia import inertial_wrench
from wrenchflow.process.mount import SensorMount
from wrenchflow.process.stamps import check_even, check_raw, finite, held_pose, segments
from wrenchflow.rig import Rig

FRAME = "base"


@dataclass(frozen=True, kw_only=True, eq=False)
class ZeroPhase:
    """The zero-phase wrench, and what it was made of.

    Attributes:
        wrench: Filtered forward and backward.
        unfiltered: The same before median and low-pass.
        inertia_left_in: Why the force that accelerates the payload is still in both; empty if it is not.
    """

    wrench: Stream
    unfiltered: Stream
    inertia_left_in: str


def causal_wrench(wrench_raw: Stream, tcp_pose: Stream, rig: Rig, bias: Bias, filter: FilterConfig) -> Stream:
    """The wrench as deployment knows it at each stamp: see `WrenchPipeline`.

    Args:
        wrench_raw: As read, wrench or force, in the sensor frame.
        tcp_pose: Poses of the tcp in the base. Samples before the first one are left out.
        rig: Sensor mount, payload and sensor rate.
        bias: Unloaded reading.
        filter: Spike filter and low-pass.

    Returns:
        A stream about the tcp, in base axes. Readings that are not finite are left out; the filter starts anew after
        each gap.

    Raises:
        StreamError: If `wrench_raw` is unevenly sampled or in another frame, or the poses are no poses.
    """
    stream, quat_wxyz = _posed(wrench_raw, tcp_pose, rig)
    rows = WrenchPipeline(rig, bias, filter).push(stream.t, stream.data, quat_wxyz)
    return finite(replace(stream, data=rows, frame=FRAME))


def zero_phase_wrench(
    wrench_raw: Stream,
    tcp_pose: Stream,
    tcp_twist: Stream | None,
    rig: Rig,
    bias: Bias,
    filter: FilterConfig,
    inertia: InertiaConfig,
) -> "ZeroPhase":
    """The wrench filtered forward and backward, at the stamps of `causal_wrench`; raises the same.

    It has no lag and looks into the future: for labels, metrics and plots. The spike filter looks to both sides, and
    the force that accelerates the payload is taken out where the tcp's twist tells it.

    Args:
        wrench_raw: See `causal_wrench`.
        tcp_pose: See `causal_wrench`.
        tcp_twist: Of the tcp in base axes; None where there is none.
        rig: See `causal_wrench`.
        bias: See `causal_wrench`.
        filter: See `causal_wrench`.
        inertia: When the payload's inertia is taken out.

    Returns:
        The stream, and what it was made of.
    """
    stream, quat_wxyz = _posed(wrench_raw, tcp_pose, rig)
    kept = finite(stream)
    if len(kept) < len(stream):
        quat_wxyz = quat_wxyz[np.isin(stream.t, kept.t)]
    data = kept.data.copy()
    inertial = inertial_wrench(tcp_twist, kept.t, SensorMount(rig).orientation(quat_wxyz), rig, inertia)
    if not isinstance(inertial, str):
        data -= inertial[:, : data.shape[1]]
    rows = WrenchPipeline(rig, bias, filter).compensate(data, quat_wxyz)
    filtered = np.empty_like(rows)
    for run in segments(kept.t, rig.sensor.rate_hz):
        filtered[run] = filtering.without_lag(rows[run], filter, rig.sensor.rate_hz)
    return ZeroPhase(
        wrench=replace(kept, data=filtered, frame=FRAME),
        unfiltered=replace(kept, data=rows, frame=FRAME),
        inertia_left_in=inertial if isinstance(inertial, str) else "",
    )


def _posed(wrench_raw: Stream, tcp_pose: Stream, rig: Rig) -> tuple[Stream, Float[np.ndarray, "n 4"]]:
    """The samples with a known pose, and the orientation of the tcp at each."""
    check_raw(wrench_raw)
    check_even(wrench_raw, rig.sensor.rate_hz, "wrench_raw")
    before, pose = held_pose(tcp_pose, wrench_raw.t)
    return replace(wrench_raw, t=wrench_raw.t[before:], data=wrench_raw.data[before:]), pose[:, 3:]
