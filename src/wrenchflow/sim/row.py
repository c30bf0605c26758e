"""One row a tick: all that a recording is made of, stored by compiled code."""

import numpy as np

from wrenchflow.compiled import kernel
from wrenchflow.control.records import JOINTS
from wrenchflow.so3 import quat_into

# Poses are x y z, then wxyz with a sign that does not flip from row to row.
ROW = np.dtype(
    [
        ("t_ns", "i8"),
        ("joint_states", "f8", 3 * JOINTS),
        ("joint_command", "f8", JOINTS),
        ("external_torque", "f8", JOINTS),
        ("tcp_pose", "f8", 7),
        ("tcp_twist", "f8", 6),
        ("wrench_raw", "f8", 6),
        ("target_pose", "f8", 7),
        ("command_pose", "f8", 7),
        ("impedance", "f8", 19),
    ],
    align=True,
)


@kernel
def record(obs, ctl, rows, index):
    """Store one tick's row; `obs` and `ctl` are arrays of one record."""
    _record(obs[0], ctl[0], rows, index)


@kernel
def _record(obs, ctl, rows, index):
    row = rows[index]
    last = rows[max(index - 1, 0)]
    row.t_ns = obs.t_ns
    for j in range(JOINTS):
        row.joint_states[j] = obs.q[j]
        row.joint_states[JOINTS + j] = obs.dq[j]
        row.joint_states[2 * JOINTS + j] = obs.tau[j]
        row.joint_command[j] = ctl.tau[j]
        row.external_torque[j] = obs.tau_external[j]
    for a in range(6):
        row.wrench_raw[a] = obs.wrench[a]
        s = 0.0
        for j in range(JOINTS):
            s += obs.J[a, j] * obs.dq[j]
        row.tcp_twist[a] = s
    _pose_into(obs.x, obs.R, last.tcp_pose, row.tcp_pose)
    _pose_into(ctl.x_target, ctl.R_target, last.target_pose, row.target_pose)
    _pose_into(ctl.x_d, ctl.R_d, last.command_pose, row.command_pose)
    for i in range(3):
        for j in range(3):
            row.impedance[3 * i + j] = ctl.K_lin[i, j]
            row.impedance[9 + 3 * i + j] = ctl.K_rot[i, j]
    row.impedance[18] = ctl.damping_ratio


@kernel
def _pose_into(x, R, near, out):
    quat = out[3:]
    w, a, b, c = near[3], near[4], near[5], near[6]
    quat_into(R, quat)
    dot = w * quat[0] + a * quat[1] + b * quat[2] + c * quat[3]
    if dot == 0.0:  # The first row: nothing to be near to, so the largest component is positive.
        dot = quat[np.argmax(np.abs(quat))]
    sign = -1.0 if dot < 0.0 else 1.0
    for i in range(3):
        out[i] = x[i]
    for i in range(4):
        quat[i] *= sign
