"""Pose increments: from where the tool is to where it is sent, as a step of an operational-space controller.

The pull of a compliant arm is in it: while the tool presses, the target lies below it. Labels that left the target's
lead out would teach a policy never to press.
"""

import numpy as np
from jaxtyping import Float32

from wrenchflow.spatial import log_so3, rotation_of, rotation_of_rot6d

COLUMNS = ("dx", "dy", "dz", "drx", "dry", "drz")
UNITS = ("m",) * 3 + ("rad",) * 3
RULE = (
    "target of the tool centre point at the next step minus its pose at this one, in base axes: position, then the "
    "rotation vector that turns the pose onto the target from the left"
)
WIDTH = len(COLUMNS)


def increments(tcp_pose: Float32[np.ndarray, "T 7"], actions: Float32[np.ndarray, "T 9"]) -> Float32[np.ndarray, "T 6"]:
    """Increments from the tool's pose to its target.

    Args:
        tcp_pose: T_base_tcp at each step, wxyz. Shape (T, 7).
        actions: Target position [m] and rot6d, in the base frame. Shape (T, 9).

    Returns:
        dx dy dz [m], drx dry drz [rad], in base axes. Shape (T, 6).
    """
    pose, target = tcp_pose.astype(np.float64), actions.astype(np.float64)
    turn = rotation_of_rot6d(target[:, 3:]) @ np.swapaxes(rotation_of(pose[:, 3:]), -1, -2)
    return np.concatenate([target[:, :3] - pose[:, :3], log_so3(turn)], axis=1).astype(np.float32)
