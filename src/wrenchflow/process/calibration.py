"""The bias of a wrist sensor, from a window of rest without contact; any other window is refused.

Bias here is the sensor's own: the weight of the payload at the window's orientation is taken out.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from wrenchflow.episode import Episode, Stream
from wrenchflow.errors import CalibrationError
from wrenchflow.process.config import BiasConfig
from wrenchflow.process.mount import SensorMount
from wrenchflow.process.stamps import check_raw, finite, held_pose
from wrenchflow.rig import Rig
from wrenchflow.signals import Signal

TARE = "tare"


@dataclass(frozen=True, kw_only=True, eq=False)
class Bias:
    """What a sensor reads without load, and how well that is known.

    Attributes:
        mean: Unloaded reading in the sensor frame, force [N] then moment [N.m]. Shape (6,), or (3,) for a force sensor.
        std: Standard deviation of one sample in the window. Shape as `mean`.
        slope_per_min: Drift over the window [N/min, N.m/min]. Shape as `mean`.
        start_ns: Start of the window [ns].
        stop_ns: End of the window, exclusive [ns].
        samples: Samples in the window.
    """

    mean: Float[np.ndarray, " d"]
    std: Float[np.ndarray, " d"]
    slope_per_min: Float[np.ndarray, " d"]
    start_ns: int
    stop_ns: int
    samples: int

    def to_mapping(self) -> dict[str, Any]:
        """Plain values, as a recording keeps them."""
        arrays = {name: getattr(self, name).tolist() for name in ("mean", "std", "slope_per_min")}
        return {**arrays, "start_ns": self.start_ns, "stop_ns": self.stop_ns, "samples": self.samples}


def bias_window(episode: Episode, config: BiasConfig) -> tuple[int, int]:
    """Start and end [ns] of the window that tells the bias: the phase `tare`, or else the first `window_s`."""
    for event in episode.events_of("phase"):
        if event.label == TARE:
            return event.start_ns, event.stop_ns
    t = episode["wrench_raw"].t
    start_ns = int(t[0]) if len(t) else 0
    return start_ns, start_ns + round(config.window_s * 1e9)


def estimate_bias(
    wrench_raw: Stream,
    tcp_pose: Stream,
    joints: Stream | None,
    rig: Rig,
    *,
    start_ns: int,
    stop_ns: int,
    config: BiasConfig | None = None,
) -> Bias:
    """Estimate the bias of a sensor over a window of rest without contact.

    Args:
        wrench_raw: As read, wrench or force, in the sensor frame.
        tcp_pose: Tells which way the payload hangs.
        joints: Tells that the arm rests; None where nobody recorded them: then motion shows in the reading only.
        rig: Sensor noise, mount and payload.
        start_ns: Start of the window [ns].
        stop_ns: End of the window, exclusive [ns].
        config: Limits of what is accepted.

    Raises:
        CalibrationError: If the window is short, the joints move, the reading spreads or drifts, or more force is left
            than a bias can be.
        StreamError: If `wrench_raw` is no wrench in the sensor frame, or a pose has no unit quaternion.
    """
    config = config or BiasConfig()
    check_raw(wrench_raw)
    window = finite(wrench_raw.between(start_ns, stop_ns))
    before, pose = held_pose(tcp_pose, window.t)
    t, rows = window.t[before:], window.data[before:]
    length_s = len(t) / rig.sensor.rate_hz
    if length_s < config.min_window_s - 1e-9:
        raise CalibrationError(
            f"the bias window is too short: got {length_s:.3f} s of finite samples with a known pose, "
            f"expected {config.min_window_s:g} s at least."
        )
    if joints is not None:
        _check_rest(joints.between(start_ns, stop_ns), config.max_joint_velocity_rad_s)

    mount = SensorMount(rig)
    unloaded = rows - mount.weight(mount.orientation(pose[:, 3:]))[:, : rows.shape[1]]
    mean = unloaded.mean(axis=0)
    std = unloaded.std(axis=0, ddof=1)
    minutes = (t - t[0]) / 60e9
    minutes -= minutes.mean()
    slope_per_min = (minutes[:, None] * (unloaded - mean)).sum(axis=0) / (minutes**2).sum()

    signal, noise = wrench_raw.signal, rig.sensor.noise[: len(mean)]
    times = "{:g} times the sensor's noise".format
    # The noise is granted on top, so that a bias at the limit is not refused by chance.
    left, limit = mean[:3], config.max_force_n + noise[:3]
    _check("is loaded", "without the payload", left, limit, signal, "a wrong payload, or a contact")
    _check("spreads", "standard deviation", std, config.max_spread * noise, signal, times(config.max_spread))
    drift = slope_per_min * (minutes[-1] - minutes[0])
    _check("drifts", "of drift", drift, config.max_drift * noise, signal, times(config.max_drift))
    return Bias(mean=mean, std=std, slope_per_min=slope_per_min, start_ns=start_ns, stop_ns=stop_ns, samples=len(t))


def _check_rest(joints: Stream, limit_rad_s: float) -> None:
    columns = [i for i, unit in enumerate(joints.signal.units) if unit == "rad/s"]
    if not len(joints):
        raise CalibrationError("the bias window has no sample of the joints, expected some that show them at rest.")
    fastest = np.abs(joints.data[:, columns]).max(axis=0)
    if not (fastest <= limit_rad_s).all():  # A NaN is no rest.
        joint = int(np.argmax(fastest))
        raise CalibrationError(
            f"the joints move in the bias window: got {fastest[joint]:.3g} rad/s in "
            f"{joints.signal.columns[columns[joint]]}, expected {limit_rad_s:g} rad/s at most."
        )


def _check(
    verb: str, what: str, got: Float[np.ndarray, " d"], limit: Float[np.ndarray, " d"], signal: Signal, why: str
) -> None:
    """Refuse the axis that is the furthest beyond its limit."""
    excess = np.abs(got) / limit
    if (excess > 1.0).any():
        i = int(np.argmax(excess))
        unit = signal.units[i]
        raise CalibrationError(
            f"the reading {verb} in the bias window: got {got[i]:.3g} {unit} {what} in {signal.columns[i]}, "
            f"expected {limit[i]:.3g} {unit} at most ({why})."
        )
