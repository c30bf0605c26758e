"""Raw wrench streams to clean ones: `wrench`, which policies get, and `wrench_zero_phase`, for labels and plots."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from wrenchflow import filtering
from wrenchflow.episode import Stream
from wrenchflow.process.calibration import Bias
from wrenchflow.process.compensation import WrenchPipeline
from wrenchflow.process.stamps import check_even, check_raw, finite, held_pose, segments
from wrenchflow.rig import Rig

FRAME = "base"


def causal_wrench(wrench_raw: Stream, tcp_pose: Stream, rig: Rig, bias: Bias, cutoff_hz: float) -> Stream:
    """The wrench as deployment knows it at each stamp: see `WrenchPipeline`.

    Args:
        wrench_raw: As read, wrench or force, in the sensor frame.
        tcp_pose: Poses of the tcp in the base. Samples before the first one are left out.
        rig: Sensor mount, payload and sensor rate.
        bias: Unloaded reading.
        cutoff_hz: The -3 dB point of the low-pass [Hz].

    Returns:
        A stream about the tcp, in base axes. Readings that are not finite are left out; the filter starts anew after
        each gap.

    Raises:
        StreamError: If `wrench_raw` is unevenly sampled or in another frame, or the poses are no poses.
    """
    stream, quat_wxyz = _posed(wrench_raw, tcp_pose, rig)
    rows = WrenchPipeline(rig, bias, cutoff_hz).push(stream.t, stream.data, quat_wxyz)
    return finite(replace(stream, data=rows, frame=FRAME))


def zero_phase_wrench(wrench_raw: Stream, tcp_pose: Stream, rig: Rig, bias: Bias, cutoff_hz: float) -> Stream:
    """The wrench filtered forward and backward, at the stamps of `causal_wrench`; takes and raises the same.

    It has no lag and looks into the future: for labels, metrics and plots.
    """
    stream, quat_wxyz = _posed(wrench_raw, tcp_pose, rig)
    rows = WrenchPipeline(rig, bias, cutoff_hz).compensate(stream.data, quat_wxyz)
    unfiltered = finite(replace(stream, data=rows, frame=FRAME))
    filtered = np.empty_like(unfiltered.data)
    for run in segments(unfiltered.t, rig.sensor.rate_hz):
        filtered[run] = filtering.zero_phase(unfiltered.data[run], cutoff_hz, rig.sensor.rate_hz)
    return replace(unfiltered, data=filtered)


def _posed(wrench_raw: Stream, tcp_pose: Stream, rig: Rig) -> tuple[Stream, Float[np.ndarray, "n 4"]]:
    """The samples with a known pose, and the orientation of the tcp at each."""
    check_raw(wrench_raw)
    check_even(wrench_raw, rig.sensor.rate_hz, "wrench_raw")
    before, pose = held_pose(tcp_pose, wrench_raw.t)
    return replace(wrench_raw, t=wrench_raw.t[before:], data=wrench_raw.data[before:]), pose[:, 3:]
