"""Joint angles that bring the tool where a scene wants it, and whether there are any."""

import mujoco
import numpy as np
from jaxtyping import Float

from wrenchflow.errors import ControlError
from wrenchflow.robot_limits import RobotLimits
from wrenchflow.sim.panda import READY_RAD
from wrenchflow.spatial import interpolate_pose, log_so3, rotation_of

_MARGIN_RAD = 0.2  # As the checks at a start want it.
_STEPS = 6


def joints_at(model: mujoco.MjModel, T_base_tcp: Float[np.ndarray, " 7"]) -> Float[np.ndarray, " 7"]:
    """Joint angles [rad] near the ready pose that put the TCP at a pose, by damped least squares.

    Raises:
        ControlError: If none do.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = READY_RAD
    site, jacobian, R_goal = model.site("tcp").id, np.zeros((6, model.nv)), rotation_of(T_base_tcp[3:])
    for _ in range(100):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        R = data.site_xmat[site].reshape(3, 3)
        error = np.concatenate([T_base_tcp[:3] - data.site_xpos[site], log_so3(R_goal @ R.T)])
        if np.abs(error).max() < 1e-10:
            return data.qpos.copy()
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)
        data.qpos += jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 1e-8 * np.eye(6), error)
    raise ControlError(f"no joint angles reach the pose {np.round(T_base_tcp, 4).tolist()}.")


def can_go(
    model: mujoco.MjModel, limits: RobotLimits, start: Float[np.ndarray, " 7"], stop: Float[np.ndarray, " 7"]
) -> bool:
    """Whether joints well within their limits bring the TCP from one pose to another, and to some in between."""
    low, high = np.array(limits.position_min_rad) + _MARGIN_RAD, np.array(limits.position_max_rad) - _MARGIN_RAD
    for weight in np.linspace(0.0, 1.0, _STEPS + 1):
        try:
            q_rad = joints_at(model, interpolate_pose(start, stop, np.array(weight)))
        except ControlError:
            return False
        if not ((low < q_rad) & (q_rad < high)).all():
            return False
    return True
