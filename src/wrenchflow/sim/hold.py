"""A hand that holds the arm by its flange, and pulls it through a spring: upstream of the wrist sensor.

The sensor sits between flange and tool, so what the hand does to the arm is not in the wrench; contact is, alone.
"""

import math

import numpy as np

from wrenchflow.compiled import kernel
from wrenchflow.control.records import JOINTS
from wrenchflow.sim.memory import floats_at
from wrenchflow.so3 import log_into, multiply_transposed_into

HOLD = np.dtype(
    [
        ("force", "u8"),  # address of the force and the torque on the flange's body, about its centre of mass
        ("centre", "u8"),  # and of that centre
        ("stiffness", "f8"),  # [N/m]; 0 for nobody
        ("damping", "f8"),  # [N.s/m]
        ("stiffness_rot", "f8"),  # [N.m/rad]
        ("damping_rot", "f8"),  # [N.m.s/rad]
        ("force_max", "f8"),  # [N]
        ("x_tcp_flange", "f8", 3),  # the flange from the TCP, in the TCP's axes [m]
        ("x", "f8", 3),  # where the hand wants the TCP
        ("R", "f8", (3, 3)),
        ("turn", "f8", (3, 3)),  # what a tick works with
        ("vector", "f8", 4),
        ("twist", "f8", 6),
    ],
    align=True,
)


@kernel
def pull(hold, obs):
    """Set what the hand does to the flange, from where the arm is measured to be; nothing where nobody holds it."""
    if hold.stiffness == 0.0:
        return
    out, centre, twist, to_flange = floats_at(hold.force, 6), floats_at(hold.centre, 3), hold.twist, hold.vector
    for a in range(6):
        twist[a] = 0.0
        for j in range(JOINTS):
            twist[a] += obs.J[a, j] * obs.dq[j]
    multiply_transposed_into(hold.R, obs.R, hold.turn)
    log_into(hold.turn, hold.vector)
    for i in range(3):
        out[3 + i] = hold.stiffness_rot * hold.vector[i] - hold.damping_rot * twist[3 + i]
    for i in range(3):
        to_flange[i] = 0.0
        for k in range(3):
            to_flange[i] += obs.R[i, k] * hold.x_tcp_flange[k]
    size = 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        speed = twist[i] + twist[3 + j] * to_flange[k] - twist[3 + k] * to_flange[j]
        # The hand turns with the flange, so where it wants the TCP it wants the flange.
        out[i] = hold.stiffness * (hold.x[i] - obs.x[i]) - hold.damping * speed
        size += out[i] * out[i]
    share = min(1.0, hold.force_max / max(math.sqrt(size), 1e-9))
    for i in range(3):
        out[i] *= share
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        arm_j, arm_k = obs.x[j] + to_flange[j] - centre[j], obs.x[k] + to_flange[k] - centre[k]
        out[3 + i] += arm_j * out[k] - arm_k * out[j]
