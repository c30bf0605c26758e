"""Mass and centre of mass of what hangs below a sensor, with the sensor's bias, from rest in several orientations.

At rest a sensor reads f = m R^T (-g) + b_f and t = c x m R^T (-g) + b_t, which is linear in the ten unknowns
(m, m c, b_f, b_t). What else is not known, how the orientation is off and how the bias drifts meanwhile, is estimated
along with them, so that the covariance says how far off the result really is.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.special import chdtrc

from wrenchflow.errors import CalibrationError
from wrenchflow.process.calibrate_config import Doubt
from wrenchflow.process.mount import GRAVITY_M_S2
from wrenchflow.rig import Payload

MIN_ORIENTATIONS = 4
MAX_CONDITION = 30.0
# Residuals that chance explains no more often than this are no noise, and all that is said of noise is too little.
UNLIKELY = 0.01
_ROUNDS = 3  # The effect of a tilt depends on the payload, which the first round finds to a thousandth.


@dataclass(frozen=True, kw_only=True, eq=False)
class PayloadEstimate:
    """What hangs below a sensor, and how well that is known.

    Attributes:
        payload: Mass, and centre of mass in the sensor frame.
        bias: The sensor's own bias, force [N] then moment [N.m], in the last recording's middle. Shape (6,).
        covariance: Of (m [kg], m c [kg.m], b_f [N], b_t [N.m]). Shape (10, 10).
        mass_std_kg: Standard deviation of the mass.
        com_std_m: Standard deviation of the centre of mass. Shape (3,).
        residual: Root mean square of what payload and bias leave, force [N] then moment [N.m]. Shape (6,).
        left: What they leave of each reading, before any doubt is reckoned with, which explains much. Shape (k, 6).
        condition: Condition number of the least squares, columns scaled to equal length.
        chance: How often noise and doubt as they are said to be leave as much or more.
        scale: What the variances were multiplied with, because they leave more than that.
    """

    payload: Payload
    bias: Float[np.ndarray, " 6"]
    covariance: Float[np.ndarray, "10 10"]
    mass_std_kg: float
    com_std_m: Float[np.ndarray, " 3"]
    residual: Float[np.ndarray, " 6"]
    left: Float[np.ndarray, "k 6"]
    condition: float
    chance: float
    scale: float


def equations(R_base_sensor: Float[np.ndarray, "k 3 3"]) -> Float[np.ndarray, "k 6 10"]:
    """What a reading at rest is, for each orientation, of the ten unknowns (m, m c, b_f, b_t). Shape (k, 6, 10)."""
    # m R^T (-g) for one kilogram, with g along -z of the base.
    up = GRAVITY_M_S2 * R_base_sensor[:, 2, :]
    A = np.zeros((len(up), 6, 10))
    A[:, :3, 0] = up
    A[:, 3:, 1:4] = -_skew(up)  # t = (m c) x up = -[up]x (m c).
    A[:, :, 4:] = np.eye(6)
    return A


def condition_of(R_base_sensor: Float[np.ndarray, "k 3 3"]) -> float:
    """Condition number of these equations with columns scaled to equal length: how well orientations tell a payload.

    Forces tell the mass and moments the rest, so it does not depend on how either is weighed.
    """
    A = equations(R_base_sensor).reshape(-1, 10)
    return float(np.linalg.cond(A / np.linalg.norm(A, axis=0)))


def identify_payload(
    R_base_sensor: Float[np.ndarray, "k 3 3"],
    wrenches: Float[np.ndarray, "k 6"],
    noise: Float[np.ndarray, "*each 6"],
    *,
    minutes: Float[np.ndarray, " k"] | None = None,
    recordings: Int[np.ndarray, " k"] | None = None,
    doubt: Doubt | None = None,
) -> PayloadEstimate:
    """Identify a payload and the sensor's bias by weighted least squares.

    Args:
        R_base_sensor: Orientation of the sensor at each rest. Shape (k, 3, 3).
        wrenches: Mean reading at each rest, in the sensor frame [N, N.m]. Shape (k, 6).
        noise: Standard deviation of one such mean, or of each [N, N.m]. Shape (6,) or (k, 6).
        minutes: When each was taken [min], in which a bias drifts; without it none does. Shape (k,).
        recordings: Number of the recording that each is of, from 0: each has a bias of its own. Shape (k,).
        doubt: What else may be wrong; without it nothing but noise is.

    Raises:
        CalibrationError: If there are fewer than 4 orientations, they excite gravity in too few directions, or no
            positive mass explains the readings.
    """
    count = len(wrenches)
    if count < MIN_ORIENTATIONS:
        raise CalibrationError(f"a payload takes {MIN_ORIENTATIONS} orientations at least, got {count}.")
    condition = condition_of(R_base_sensor)
    if not condition < MAX_CONDITION:
        raise CalibrationError(
            f"the orientations excite gravity in too few directions: got a condition number of {condition:.3g} over "
            f"{count} orientations, expected less than {MAX_CONDITION:g}. Tilt the tool about two axes."
        )
    of = np.zeros(count, np.int64) if recordings is None else recordings
    when = np.zeros(count) if minutes is None else minutes
    unknowns, covariance, left, chance, scale = _solve(R_base_sensor, wrenches, noise, when, of, doubt)

    mass_kg, com_m = float(unknowns[0]), unknowns[1:4] / unknowns[0]
    if not mass_kg > 0.0:
        raise CalibrationError(
            f"no payload explains the readings: got a mass of {mass_kg:.3g} kg, expected more than 0. "
            "The sensor's frame or sign may be wrong."
        )
    # c = (m c) / m, to first order.
    jacobian = np.concatenate([-com_m[:, None], np.eye(3)], axis=1) / mass_kg
    com_covariance = jacobian @ covariance[:4, :4] @ jacobian.T
    return PayloadEstimate(
        payload=Payload(mass_kg=mass_kg, com_sensor_m=(float(com_m[0]), float(com_m[1]), float(com_m[2]))),
        bias=unknowns[4:],
        covariance=covariance,
        mass_std_kg=float(np.sqrt(covariance[0, 0])),
        com_std_m=np.sqrt(np.diag(com_covariance)),
        residual=np.sqrt((left**2).mean(axis=0)),
        left=left,
        condition=condition,
        chance=chance,
        scale=scale,
    )


def _solve(
    R_base_sensor: Float[np.ndarray, "k 3 3"],
    wrenches: Float[np.ndarray, "k 6"],
    noise: Float[np.ndarray, "*each 6"],
    minutes: Float[np.ndarray, " k"],
    of: Int[np.ndarray, " k"],
    doubt: Doubt | None,
) -> tuple[Float[np.ndarray, " 10"], Float[np.ndarray, "10 10"], Float[np.ndarray, "k 6"], float, float]:
    """The ten unknowns with the last recording's bias, their covariance, what is left, and how likely that is.

    The columns are m, m c, then a bias for each recording; with doubt then a tilt, and a drift for each recording,
    which are known beforehand to be about 0.
    """
    own, groups = equations(R_base_sensor), int(of.max()) + 1
    up = own[:, :3, 0]
    each = np.eye(groups)[of]  # (k, groups): 1 where a reading is of that recording.
    biases = np.einsum("kg,ij->kigj", each, np.eye(6)).reshape(len(of), 6, -1)
    base = np.concatenate([own[:, :, :4], biases], axis=2)
    width = base.shape[2]
    middle = (each * minutes[:, None]).sum(axis=0) / each.sum(axis=0)
    drifts = biases * (minutes - middle[of])[:, None, None]

    weigh = 1.0 / np.broadcast_to(noise, wrenches.shape)
    right = (wrenches * weigh).ravel()
    unknowns, covariance, excess = _least_squares((base * weigh[:, :, None]).reshape(-1, width), right)
    left, freedom = wrenches - base @ unknowns, len(right) - width
    if doubt is not None:
        spread = _spread(doubt, groups)
        known = np.concatenate([np.zeros((len(spread), width)), np.diag(1.0 / spread)], axis=1)
        right = np.concatenate([right, np.zeros(len(spread))])
        for _ in range(_ROUNDS):
            A = np.concatenate([base, _tilt(up, unknowns), drifts], axis=2) * weigh[:, :, None]
            system = np.concatenate([A.reshape(-1, known.shape[1]), known])
            unknowns, covariance, excess = _least_squares(system, right)
    chance = float(chdtrc(freedom, excess)) if freedom else 1.0
    scale = excess / freedom if chance < UNLIKELY else 1.0
    kept = np.r_[0:4, width - 6 : width]
    return unknowns[kept], scale * covariance[np.ix_(kept, kept)], left, chance, scale


def _least_squares(
    system: Float[np.ndarray, "n m"], right: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m m"], float]:
    """The unknowns, their covariance where rows are of unit variance, and the sum of the squares that are left."""
    length = np.linalg.norm(system, axis=0)
    scaled, *_ = np.linalg.lstsq(system / length, right)
    unknowns = scaled / length
    covariance = np.linalg.inv((system / length).T @ (system / length)) / np.outer(length, length)
    return unknowns, covariance, float(((right - system @ unknowns) ** 2).sum())


def _spread(doubt: Doubt, groups: int) -> Float[np.ndarray, " n"]:
    """Standard deviations of tilt and drifts. Shape (3 + 6 groups,)."""
    tilt = np.full(3, doubt.orientation_rad / np.sqrt(3.0))
    return np.concatenate([tilt, np.tile(np.repeat([doubt.drift_n_min, doubt.drift_nm_min], 3), groups)])


def _tilt(up: Float[np.ndarray, "k 3"], unknowns: Float[np.ndarray, " n"]) -> Float[np.ndarray, "k 6 3"]:
    """What a small rotation of all orientations, in the sensor's axes, changes of what a payload makes it read.

    The true way up is up + tilt x up, so f changes by -m [up]x tilt, and t by -[m c]x [up]x tilt.
    """
    turned = -_skew(up)
    return np.concatenate([unknowns[0] * turned, _skew(unknowns[None, 1:4]) @ turned], axis=1)


def _skew(vectors: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3 3"]:
    """[v]x of each row, so that [v]x w = v x w."""
    x, y, z = vectors.T
    zero = np.zeros(len(vectors))
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)
