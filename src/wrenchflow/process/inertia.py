"""What accelerating the payload makes a sensor read.

f = m a of the payload's centre of mass, and t = c x f about the sensor's origin. The payload's own moment of inertia is
not known to the rig and stays: a compact tool of half a kilogram makes 0.001 N.m at 2 rad/s^2.
"""

import numpy as np
from jaxtyping import Float

from wrenchflow.episode import Stream
from wrenchflow.filtering import zero_phase
from wrenchflow.process.config import InertiaConfig
from wrenchflow.process.mount import SensorMount, rotate
from wrenchflow.process.stamps import GAP_PERIODS
from wrenchflow.rig import Rig
from wrenchflow.spatial import cross


def inertial_wrench(
    tcp_twist: Stream | None,
    t: np.ndarray,
    R_base_sensor: Float[np.ndarray, "n 3 3"],
    rig: Rig,
    config: InertiaConfig,
) -> Float[np.ndarray, "n 6"] | str:
    """The wrench that the payload's acceleration makes the sensor read.

    Args:
        tcp_twist: Of the tcp in base axes; None where there is none.
        t: Stamps of the readings [ns]. Shape (n,).
        R_base_sensor: Orientation of the sensor at each. Shape (n, 3, 3).
        rig: Payload, and where it hangs.
        config: How the acceleration is found.

    Returns:
        Force [N] and moment [N.m] in the sensor frame, shape (n, 6); or why nothing is to be taken out.
    """
    if not config.compensate:
        return "it is switched off"
    if not rig.payload.mass_kg:
        return "the rig has no payload"
    if tcp_twist is None or len(tcp_twist) < 3:
        return "there is no stream 'tcp_twist'"
    steps_ns = np.diff(tcp_twist.t)
    rate_hz = 1e9 / float(np.median(steps_ns))
    if not np.isfinite(tcp_twist.data).all() or (steps_ns > GAP_PERIODS * np.median(steps_ns)).any():
        return "the stream 'tcp_twist' has gaps"
    if rate_hz < 4.0 * config.cutoff_hz:
        return f"the stream 'tcp_twist' comes at {rate_hz:.4g} Hz, expected {4.0 * config.cutoff_hz:g} Hz at least"
    twist = zero_phase(tcp_twist.data, config.cutoff_hz, rate_hz)
    acceleration = np.gradient(twist, 1.0 / rate_hz, axis=0)
    row = np.clip(np.searchsorted(tcp_twist.t, t, side="right") - 1, 0, len(twist) - 1)
    mount = SensorMount(rig)
    arm = rotate(R_base_sensor, np.broadcast_to(mount.com_tcp_m, (len(t), 3)))
    omega, alpha = twist[row, 3:], acceleration[row, 3:]
    a_com = acceleration[row, :3] + np.cross(alpha, arm) + np.cross(omega, np.cross(omega, arm))
    largest_m_s2 = float(np.linalg.norm(a_com, axis=1).max(initial=0.0))
    if largest_m_s2 < config.least_m_s2:
        return f"the payload accelerates by {largest_m_s2:.2g} m/s^2 at most, {config.least_m_s2:g} needed"
    force = rig.payload.mass_kg * rotate(R_base_sensor.transpose(0, 2, 1), a_com)
    return np.concatenate([force, cross(np.array(rig.payload.com_sensor_m), force)], axis=1)
