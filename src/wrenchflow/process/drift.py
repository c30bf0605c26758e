"""How much a sensor's bias drifts over an episode, from rest without contact at its start and at its end."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import CalibrationError, StreamError
from wrenchflow.process.calibrate_config import Doubt
from wrenchflow.process.calibration import Bias, estimate_bias
from wrenchflow.process.config import BiasConfig
from wrenchflow.process.finding import NotAssessed
from wrenchflow.process.means import standard_error
from wrenchflow.process.mount import SensorMount
from wrenchflow.process.stamps import finite, held_pose
from wrenchflow.rig import Rig

KIND = "bias-drift"
_RING_S = 0.1  # After a contact the tool still swings.
_MIN_APART_S = 2.0  # In less, noise is more than any drift.


@dataclass(frozen=True, kw_only=True, eq=False)
class BiasDrift:
    """Change of a sensor's bias in the sensor frame, force [N/min] before moment [N.m/min].

    Attributes:
        slope_per_min: From the first window to the last. Shape (6,), or (3,) for a force sensor.
        std_per_min: Standard deviation of it: noise, and how far off the arm's orientation may be. Shape as
            `slope_per_min`.
        start: The bias at the start.
        stop: The bias at the end.
    """

    slope_per_min: Float[np.ndarray, " d"]
    std_per_min: Float[np.ndarray, " d"]
    start: Bias
    stop: Bias


def bias_drift(
    episode: Episode,
    rig: Rig,
    start: Bias,
    contacts: Sequence[Event],
    *,
    config: BiasConfig | None = None,
    doubt: Doubt | None = None,
) -> BiasDrift | NotAssessed:
    """Compare the bias at the end of an episode with that at its start.

    Args:
        episode: With `wrench_raw`, `tcp_pose`, and `joint_states` where somebody recorded them.
        rig: Sensor noise, mount and payload.
        start: The bias that `estimate_bias` found at the start.
        contacts: Where the tool touched something.
        config: What rest is; at the end a bias may be off by any force, for that is what is looked for.
        doubt: How far off the arm's orientation may be, which matters where the tool hangs otherwise at the end.

    Returns:
        The drift, or why it cannot be told.
    """
    config = config or BiasConfig()
    raw = episode["wrench_raw"]
    if not len(raw):
        return NotAssessed(kind=KIND, reason="there are no samples")
    stop_ns = int(raw.t[-1]) + 1
    last_ns = max((event.stop_ns for event in contacts), default=start.stop_ns)
    free_ns = max(last_ns + round(_RING_S * 1e9), stop_ns - round(config.window_s * 1e9))
    if (stop_ns - free_ns) * 1e-9 < config.min_window_s:
        return NotAssessed(
            kind=KIND, reason=f"the recording does not end free of contact for {config.min_window_s + _RING_S:g} s"
        )
    apart_s = (0.5 * (free_ns + stop_ns) - 0.5 * (start.start_ns + start.stop_ns)) * 1e-9
    if apart_s < _MIN_APART_S:
        return NotAssessed(
            kind=KIND,
            reason=f"start and end are {apart_s:.2g} s apart, too little to tell a drift from noise",
        )
    try:
        # Any force is let pass: what is left at the end is what drifted.
        anyhow = replace(config, max_force_n=np.inf)
        joints = episode.streams.get("joint_states")
        stop = estimate_bias(raw, episode["tcp_pose"], joints, rig, start_ns=free_ns, stop_ns=stop_ns, config=anyhow)
        error = _error(raw, episode["tcp_pose"], rig, (start, stop), doubt or Doubt())
    except (CalibrationError, StreamError) as refused:
        return NotAssessed(kind=KIND, reason=f"no rest at the end: {refused}")
    minutes = apart_s / 60.0
    return BiasDrift(
        slope_per_min=(stop.mean - start.mean) / minutes, std_per_min=error / minutes, start=start, stop=stop
    )


def _error(
    raw: Stream, tcp_pose: Stream, rig: Rig, windows: tuple[Bias, Bias], doubt: Doubt
) -> Float[np.ndarray, " d"]:
    """Standard deviation of the difference of two biases. Shape (d,)."""
    mount, variance, hung = SensorMount(rig), np.zeros(raw.signal.width), []
    for window in windows:
        part = finite(raw.between(window.start_ns, window.stop_ns))
        before, pose = held_pose(tcp_pose, part.t)
        weight = mount.weight(mount.orientation(pose[:, 3:]))
        variance += standard_error(part.data[before:] - weight[:, : raw.signal.width], 1.0 / rig.sensor.rate_hz) ** 2
        hung.append(weight.mean(axis=0))
    # A constant tilt of the orientation turns both weights alike, so only their difference is off: across itself.
    force, moment = np.linalg.norm((hung[1] - hung[0])[:3]), np.linalg.norm((hung[1] - hung[0])[3:])
    tilt_rad = doubt.orientation_rad / np.sqrt(3.0)
    return np.sqrt(variance + (tilt_rad * np.repeat([force, moment], 3)[: raw.signal.width]) ** 2)
