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
