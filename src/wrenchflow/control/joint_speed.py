"""How fast a joint may go where it is: of some robots the limit falls towards the ends of the joint.

`RobotLimits.speed_limits` is the same for whole arrays of postures; a test holds both against each other.
"""

import math

import numpy as np

from wrenchflow.compiled import kernel
from wrenchflow.robot_limits import RobotLimits


def set_speed_limits(ctl: np.ndarray, robot: RobotLimits) -> None:
    """Put a robot's joint speed limits into one `CTL` record."""
    state = ctl[0]
    state["dq_max"] = robot.velocity_rad_s
    if robot.slowing is None:
        for name in ("dq_slope", "dq_offset", "dq_q_min", "dq_q_max"):
            state[name] = 0.0
    else:
        state["dq_slope"], state["dq_offset"] = robot.slowing.slope_rad_s2, robot.slowing.offset_rad_s
        state["dq_q_min"], state["dq_q_max"] = robot.slowing.min_rad, robot.slowing.max_rad


@kernel
def speed_limit(ctl, joint, q, dq):
    """The largest speed [rad/s] that a joint at `q` [rad] may have in the direction of `dq`; 0 at the curve's end."""
    most = ctl.dq_max[joint]
    if not ctl.dq_slope[joint] > 0.0:
        return most
    room = ctl.dq_q_max[joint] - q if dq >= 0.0 else q - ctl.dq_q_min[joint]
    limit = math.sqrt(max(0.0, ctl.dq_slope[joint] * room)) - ctl.dq_offset[joint]
    return min(most, max(0.0, limit))
