"""Mass and centre of mass of what hangs below a sensor, with the sensor's bias, from rest in several orientations.

At rest a sensor reads f = m R^T (-g) + b_f and t = c x m R^T (-g) + b_t, which is linear in the ten unknowns
(m, m c, b_f, b_t).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wrenchflow.errors import CalibrationError
from wrenchflow.process.mount import GRAVITY_M_S2
from wrenchflow.rig import Payload

MIN_ORIENTATIONS = 4
MAX_CONDITION = 30.0


@dataclass(frozen=True, kw_only=True, eq=False)
class PayloadEstimate:
    """What hangs below a sensor, and how well that is known.

    Attributes:
        payload: Mass, and centre of mass in the sensor frame.
        bias: The sensor's own bias, force [N] then moment [N.m]. Shape (6,).
        covariance: Of (m [kg], m c [kg.m], b_f [N], b_t [N.m]). Shape (10, 10).
        mass_std_kg: Standard deviation of the mass.
        com_std_m: Standard deviation of the centre of mass. Shape (3,).
        residual: Root mean square of what the model leaves, force [N] then moment [N.m]. Shape (6,).
        condition: Condition number of the least squares, columns scaled to equal length.
    """

    payload: Payload
    bias: Float[np.ndarray, " 6"]
    covariance: Float[np.ndarray, "10 10"]
    mass_std_kg: float
    com_std_m: Float[np.ndarray, " 3"]
    residual: Float[np.ndarray, " 6"]
    condition: float


def identify_payload(
    R_base_sensor: Float[np.ndarray, "k 3 3"], wrenches: Float[np.ndarray, "k 6"], noise: Float[np.ndarray, " 6"]
) -> PayloadEstimate:
    """Identify a payload and the sensor's bias by weighted least squares.

    Args:
        R_base_sensor: Orientation of the sensor at each rest. Shape (k, 3, 3).
        wrenches: Mean reading at each rest, in the sensor frame [N, N.m]. Shape (k, 6).
        noise: Standard deviation of one such mean [N, N.m]. Shape (6,).

    Raises:
        CalibrationError: If there are fewer than 4 orientations, they excite gravity in too few directions, or no
            positive mass explains the readings.
    """
    count = len(wrenches)
    if count < MIN_ORIENTATIONS:
        raise CalibrationError(f"a payload takes {MIN_ORIENTATIONS} orientations at least, got {count}.")
    # m R^T (-g) for one kilogram, with g along -z of the base.
    up = GRAVITY_M_S2 * R_base_sensor[:, 2, :]
    zero = np.zeros(count)
    A = np.zeros((count, 6, 10))
    A[:, :3, 0] = up
    # t = (m c) x up = -[up]x (m c).
    A[:, 3:, 1:4] = np.array(
        [[zero, up[:, 2], -up[:, 1]], [-up[:, 2], zero, up[:, 0]], [up[:, 1], -up[:, 0], zero]]
    ).transpose(2, 0, 1)
    A[:, :, 4:] = np.eye(6)

    weighted = (A / noise[:, None]).reshape(-1, 10)
    length = np.linalg.norm(weighted, axis=0)
    condition = float(np.linalg.cond(weighted / length))
    if not condition < MAX_CONDITION:
        raise CalibrationError(
            f"the orientations excite gravity in too few directions: got a condition number of {condition:.3g} over "
            f"{count} orientations, expected less than {MAX_CONDITION:g}. Tilt the tool about two axes."
        )
    scaled, *_ = np.linalg.lstsq(weighted / length, (wrenches / noise).ravel())
    unknowns = scaled / length
    covariance = np.linalg.inv((weighted / length).T @ (weighted / length)) / np.outer(length, length)
    mass_kg, moment = float(unknowns[0]), unknowns[1:4]
    if not mass_kg > 0.0:
        raise CalibrationError(
            f"no payload explains the readings: got a mass of {mass_kg:.3g} kg, expected more than 0. "
            "The sensor's frame or sign may be wrong."
        )
    com_m = moment / mass_kg
    # c = (m c) / m, to first order.
    jacobian = np.concatenate([-com_m[:, None], np.eye(3)], axis=1) / mass_kg
    com_covariance = jacobian @ covariance[:4, :4] @ jacobian.T
    residual = wrenches - (A @ unknowns)
    return PayloadEstimate(
        payload=Payload(mass_kg=mass_kg, com_sensor_m=(float(com_m[0]), float(com_m[1]), float(com_m[2]))),
        bias=unknowns[4:],
        covariance=covariance,
        mass_std_kg=float(np.sqrt(covariance[0, 0])),
        com_std_m=np.sqrt(np.diag(com_covariance)),
        residual=np.sqrt((residual**2).mean(axis=0)),
        condition=condition,
    )
