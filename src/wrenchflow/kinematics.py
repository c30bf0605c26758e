"""Where the Panda's flange is for its joint angles, by the manufacturer's table: without a simulator, for any room.

Source: the manufacturer's interface documentation (modified DH table, after Craig).
"""

import math
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from wrenchflow.spatial import compose, make_pose

# Modified DH a joint: a [m], d [m], alpha [rad]; theta is the joint angle. The flange follows joint 7.
DH = (
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -math.pi / 2),
    (0.0, 0.316, math.pi / 2),
    (0.0825, 0.0, math.pi / 2),
    (-0.0825, 0.384, -math.pi / 2),
    (0.0, 0.0, math.pi / 2),
    (0.088, 0.0, math.pi / 2),
)
FLANGE_M = 0.107

# From joint angles [rad] to T_base_tcp.
Kinematics = Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " 7"]]


def flange_pose(q_rad: Float[np.ndarray, " 7"]) -> Float[np.ndarray, " 7"]:
    """T_base_flange of the Panda's joint angles [rad]."""
    position_m, R = np.zeros(3), np.eye(3)
    for (a, d, alpha), theta in zip(DH, q_rad, strict=True):
        ca, sa, ct, st = math.cos(alpha), math.sin(alpha), math.cos(theta), math.sin(theta)
        position_m = position_m + R @ np.array([a, -d * sa, d * ca])
        R = R @ np.array([[ct, -st, 0.0], [st * ca, ct * ca, -sa], [st * sa, ct * sa, ca]])
    return make_pose(position_m + R[:, 2] * FLANGE_M, R)


def panda_tcp(T_flange_tcp: Float[np.ndarray, " 7"]) -> Kinematics:
    """The kinematics of a Panda with a tool.

    Args:
        T_flange_tcp: Where the tool's tip is. Shape (7,).
    """

    def tcp_pose(q_rad: Float[np.ndarray, " n"]) -> Float[np.ndarray, " 7"]:
        return compose(flange_pose(q_rad), T_flange_tcp)

    return tcp_pose


def jacobians(
    q_rad: Float[np.ndarray, "n 7"], T_flange_tcp: Float[np.ndarray, " 7"]
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 6 7"]]:
    """Where the TCP is, and how fast joints move it, of many postures at once.

    Args:
        q_rad: Joint angles. Shape (n, 7).
        T_flange_tcp: Where the tool's tip is. Shape (7,).

    Returns:
        Position in the base [m], shape (n, 3); and J, base axes, linear rows first, shape (n, 6, 7).
    """
    count = len(q_rad)
    position_m, R = np.zeros((count, 3)), np.broadcast_to(np.eye(3), (count, 3, 3))
    origins, axes = [], []
    for (a, d, alpha), theta in zip(DH, q_rad.T, strict=True):
        ca, sa, ct, st = math.cos(alpha), math.sin(alpha), np.cos(theta), np.sin(theta)
        position_m = position_m + R @ np.array([a, -d * sa, d * ca])
        zero = np.zeros(count)
        turn = np.array([[ct, -st, zero], [st * ca, ct * ca, zero - sa], [st * sa, ct * sa, zero + ca]])
        R = R @ turn.transpose(2, 0, 1)
        origins.append(position_m)
        axes.append(R[:, :, 2])
    position_m = position_m + R @ (np.array([0.0, 0.0, FLANGE_M]) + T_flange_tcp[:3])
    columns = [np.concatenate([np.cross(z, position_m - o), z], axis=1) for o, z in zip(origins, axes, strict=True)]
    return position_m, np.stack(columns, axis=2)
