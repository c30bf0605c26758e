"""The wrench that a Panda without a force sensor exerts, estimated from the torques of its joints.

A measured joint torque holds what gravity asks for, what the arm exerts on its environment, and what nobody models
(friction, acceleration, the sensors' bias). Less gravity and a bias, `tau = J^T w + e` has seven equations for the six
numbers of w: weighted least squares (Aitken, 1935) gives w, its covariance, and one number that says whether the
uncertainty that was assumed of the torques can be true. Where it cannot, the uncertainty is raised until it can, as
Birge did (1932).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from wrenchflow.compiled import kernel
from wrenchflow.datasets.analysis.config import AnalysisConfig
from wrenchflow.kinematics import DH, FLANGE_M
from wrenchflow.panda_links import LINKS

GRAVITY_M_S2 = 9.81
JOINTS = 7
# Where a force is that uncertain the posture lets the arm hardly feel it: nothing is told.
_LARGEST_STD_N = 50.0
_DH = np.array([(a, d, math.cos(alpha), math.sin(alpha)) for a, d, alpha in DH])
_MASSES_KG = np.array([mass for mass, _, _ in LINKS[1:]])
_COMS_M = np.array([com for _, com, _ in LINKS[1:]])


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """An estimated wrench: what the robot exerts on its environment, base axes, about the flange.

    Attributes:
        wrench: Force [N] and moment [N.m]; NaN where the posture does not let it be told. Shape (n, 6).
        std: Standard uncertainty of each. Shape (n, 6).
        touch: Of the force, its squared distance from zero in terms of its covariance: above 16.3 for one row in a
            thousand where there is no force. Shape (n,).
        misfit: How much the torques contradict each other, by what was assumed of them: 1 or less where the assumption
            holds.
    """

    wrench: Float[np.ndarray, "n 6"]
    std: Float[np.ndarray, "n 6"]
    touch: Float[np.ndarray, " n"]
    misfit: float


@kernel
def _frames(q, dh, flange, masses, coms, hand_mass, hand_com, gravity, jacobian, holding):
    """Jacobian of the flange and the torques that hold the arm up, of one posture."""
    n = q.shape[0]
    position, turn = np.zeros(3), np.eye(3)
    origins, axes = np.empty((n, 3)), np.empty((n, 3))
    centres = np.empty((n + 1, 3))
    for i in range(n):
        a, d, ca, sa = dh[i, 0], dh[i, 1], dh[i, 2], dh[i, 3]
        for k in range(3):
            position[k] += turn[k, 0] * a - turn[k, 1] * d * sa + turn[k, 2] * d * ca
        ct, st = math.cos(q[i]), math.sin(q[i])
        for k in range(3):
            x, y, z = turn[k, 0], turn[k, 1], turn[k, 2]
            turn[k, 0] = x * ct + y * st * ca + z * st * sa
            turn[k, 1] = -x * st + y * ct * ca + z * ct * sa
            turn[k, 2] = -y * sa + z * ca
        for k in range(3):
            origins[i, k] = position[k]
            axes[i, k] = turn[k, 2]
            centres[i, k] = position[k] + turn[k, 0] * coms[i, 0] + turn[k, 1] * coms[i, 1] + turn[k, 2] * coms[i, 2]
    for k in range(3):
        position[k] += turn[k, 2] * flange
        centres[n, k] = position[k] + turn[k, 0] * hand_com[0] + turn[k, 1] * hand_com[1] + turn[k, 2] * hand_com[2]
    for i in range(n):
        x, y, z = axes[i]
        rx, ry, rz = position[0] - origins[i, 0], position[1] - origins[i, 1], position[2] - origins[i, 2]
        jacobian[0, i] = y * rz - z * ry
        jacobian[1, i] = z * rx - x * rz
        jacobian[2, i] = x * ry - y * rx
        jacobian[3, i], jacobian[4, i], jacobian[5, i] = x, y, z
        # The height of what hangs beyond the joint, by its angle: (axis x lever) . up.
        total = 0.0
        for j in range(i, n + 1):
            mass = masses[j] if j < n else hand_mass
            total += mass * (x * (centres[j, 1] - origins[i, 1]) - y * (centres[j, 0] - origins[i, 0]))
        holding[i] = gravity * total


@kernel
def _holding(q, out, dh, flange, masses, coms, hand_mass, hand_com, gravity):
    """Torques that hold the arm up, of many postures."""
    jacobian = np.empty((6, q.shape[1]))
    for row in range(q.shape[0]):
        _frames(q[row], dh, flange, masses, coms, hand_mass, hand_com, gravity, jacobian, out[row])


@kernel
def _inverse(a, out):
    """Inverse of a symmetric positive definite matrix by its Cholesky factor; False if it has none."""
    n = a.shape[0]
    lower = np.zeros((n, n))
    for i in range(n):
        for j in range(i + 1):
            total = a[i, j]
            for k in range(j):
                total -= lower[i, k] * lower[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                lower[i, i] = math.sqrt(total)
            else:
                lower[i, j] = total / lower[j, j]
    # The factor's own inverse, then its square.
    for i in range(n):
        lower[i, i] = 1.0 / lower[i, i]
        for j in range(i):
            total = 0.0
            for k in range(j, i):
                total += lower[i, k] * lower[k, j]
            lower[i, j] = -total * lower[i, i]
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(max(i, j), n):
                total += lower[k, i] * lower[k, j]
            out[i, j] = total
    return True


@kernel
def _solve(q, tau, weights, wrench, variance, touch, misfit, dh, flange, masses, coms, hand_mass, hand_com, gravity):
    """Weighted least squares of each row."""
    joints = q.shape[1]
    jacobian, holding = np.empty((6, joints)), np.empty(joints)
    normal, covariance, right = np.empty((6, 6)), np.empty((6, 6)), np.empty(6)
    inner, inner_inverse = np.empty((3, 3)), np.empty((3, 3))
    for row in range(q.shape[0]):
        _frames(q[row], dh, flange, masses, coms, hand_mass, hand_com, gravity, jacobian, holding)
        for i in range(6):
            right[i] = 0.0
            for k in range(joints):
                right[i] += jacobian[i, k] * weights[k] * tau[row, k]
            for j in range(6):
                normal[i, j] = 0.0
                for k in range(joints):
                    normal[i, j] += jacobian[i, k] * weights[k] * jacobian[j, k]
        if not _inverse(normal, covariance):
            wrench[row], variance[row], touch[row], misfit[row] = np.nan, np.nan, np.nan, np.nan
            continue
        for i in range(6):
            wrench[row, i] = 0.0
            for j in range(6):
                wrench[row, i] += covariance[i, j] * right[j]
            variance[row, i] = covariance[i, i]
        for i in range(3):
            for j in range(3):
                inner[i, j] = covariance[i, j]
        distance = np.nan
        if _inverse(inner, inner_inverse):
            distance = 0.0
            for i in range(3):
                for j in range(3):
                    distance += wrench[row, i] * inner_inverse[i, j] * wrench[row, j]
        touch[row] = distance
        total = 0.0
        for k in range(joints):
            left = tau[row, k]
            for i in range(6):
                left -= jacobian[i, k] * wrench[row, i]
            total += left * left * weights[k]
        misfit[row] = total


def holding_torque(q_rad: Float[np.ndarray, "n 7"], config: AnalysisConfig) -> Float[np.ndarray, "n 7"]:
    """Torques that hold the arm and its hand up against gravity [N.m]. Shape (n, 7)."""
    out = np.empty((len(q_rad), JOINTS))
    _holding(np.ascontiguousarray(q_rad, np.float64), out, *_model(config))
    return out


def estimate_wrench(
    q_rad: Float[np.ndarray, "n 7"], torque_nm: Float[np.ndarray, "n 7"], resting: int, config: AnalysisConfig
) -> Estimate:
    """Estimate the wrench of each row.

    Args:
        q_rad: Joint angles. Shape (n, 7).
        torque_nm: Measured torques of the joints, with what gravity asks for, as libfranka gives them. Shape (n, 7).
        resting: The first so many rows are without contact; their mean is the torques' bias.
        config: What hangs at the flange, and how uncertain a torque is.
    """
    count = len(q_rad)
    q_rad = np.ascontiguousarray(q_rad, np.float64)
    left = torque_nm - holding_torque(q_rad, config)
    left -= left[: max(resting, 1)].mean(axis=0)
    wrench, variance = np.empty((count, 6)), np.empty((count, 6))
    touch, misfit = np.empty(count), np.empty(count)
    weights = np.array(config.torque_std_nm) ** -2.0
    _solve(q_rad, np.ascontiguousarray(left), weights, wrench, variance, touch, misfit, *_model(config))
    told = np.isfinite(misfit)
    # One equation more than unknowns: the expected square of what is left over is 1.
    raised = max(float(misfit[told].mean()) if told.any() else 1.0, 1.0)
    std = np.sqrt(variance * raised)
    far = ~(std[:, :3].max(axis=1, initial=0.0) <= _LARGEST_STD_N)
    wrench[far], std[far] = np.nan, np.nan
    return Estimate(wrench=wrench, std=std, touch=np.where(far, np.nan, touch / raised), misfit=raised)


def _model(config: AnalysisConfig) -> Any:
    return (_DH, FLANGE_M, _MASSES_KG, _COMS_M, config.hand_mass_kg, np.array(config.hand_com_m), GRAVITY_M_S2)
