"""Where the sensor sits, and what the payload's weight makes it read.

A sensor between the arm and its tool reads f_s = f_robot_on_environment + m (a - g) in its own axes, and the moment
of the same about its own origin. So a tool that hangs still reads its weight, upwards.
"""

import numpy as np
from jaxtyping import Float

from wrenchflow.rig import Rig
from wrenchflow.spatial import compose, cross, inverse, rotation_of

GRAVITY_M_S2 = 9.81


def rotate(R: Float[np.ndarray, "n 3 3"], vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """R v of each row, written out so that a row's bits do not depend on how many rows there are."""
    x, y, z = vectors[:, 0, None], vectors[:, 1, None], vectors[:, 2, None]
    return R[:, :, 0] * x + R[:, :, 1] * y + R[:, :, 2] * z


class SensorMount:
    """The sensor, the tcp and the payload of a rig, as they stand to each other."""

    def __init__(self, rig: Rig) -> None:
        """Work out the constant transforms of `rig`."""
        T_flange_tcp, T_flange_sensor = np.array(rig.T_flange_tcp), np.array(rig.sensor.T_flange_sensor)
        self._R_tcp_sensor = rotation_of(compose(inverse(T_flange_tcp), T_flange_sensor)[3:])
        self._tcp_sensor_m = compose(inverse(T_flange_sensor), T_flange_tcp)[:3]
        self._mass_kg = rig.payload.mass_kg
        self._com_m = np.array(rig.payload.com_sensor_m)

    @property
    def com_tcp_m(self) -> Float[np.ndarray, " 3"]:
        """From the tcp to the payload's centre of mass, in the axes of the sensor. Shape (3,)."""
        return self._com_m - self._tcp_sensor_m

    def orientation(self, quat_wxyz: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3 3"]:
        """R_base_sensor of the tcp's orientation in the base. Shape (n, 3, 3)."""
        R_base_tcp = rotation_of(quat_wxyz)
        columns = [rotate(R_base_tcp, np.broadcast_to(self._R_tcp_sensor[:, k], (len(quat_wxyz), 3))) for k in range(3)]
        return np.stack(columns, axis=-1)

    def weight(self, R_base_sensor: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 6"]:
        """What the payload at rest makes the sensor read, in the sensor frame [N, N.m]. Shape (n, 6)."""
        # m R^T (-g) with g along -z of the base: the last row of R, times m |g|.
        force = self._mass_kg * GRAVITY_M_S2 * R_base_sensor[:, 2, :]
        return np.concatenate([force, cross(self._com_m, force)], axis=1)

    def to_tcp(
        self, R_base_sensor: Float[np.ndarray, "n 3 3"], wrench: Float[np.ndarray, "n d"]
    ) -> Float[np.ndarray, "n d"]:
        """Refer a wrench (or a force) in the sensor frame to the tcp, in base axes. Shape as `wrench`."""
        force = rotate(R_base_sensor, wrench[:, :3])
        if wrench.shape[1] == 3:
            return force
        moment = wrench[:, 3:] - cross(self._tcp_sensor_m, wrench[:, :3])
        return np.concatenate([force, rotate(R_base_sensor, moment)], axis=1)
