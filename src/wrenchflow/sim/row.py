"""One row a tick: all that a recording is made of, stored by compiled code."""

import math

import numpy as np

from wrenchflow import signals
from wrenchflow.compiled import kernel
from wrenchflow.control.records import JOINTS
from wrenchflow.so3 import quat_into

# Poses are x y z, then wxyz with a sign that does not flip from row to row. `impedance` is what was given, `request`
# what was asked for, and `governor` why they differ.
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
        ("impedance", "f8", signals.IMPEDANCE.width),
        ("request", "f8", signals.REQUEST.width),
        ("governor", "f8", signals.GOVERNOR.width),
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
            row.request[3 * i + j] = ctl.K_lin_target[i, j]
            row.request[9 + 3 * i + j] = ctl.K_rot_target[i, j]
    row.impedance[18] = ctl.damping_ratio
    row.request[18] = ctl.damping_ratio_target
    for a in range(6):
        row.request[19 + a] = ctl.wrench_target[a]
    row.request[25] = ctl.gripper_target
    _governor_into(ctl, row.governor)


@kernel
def _governor_into(ctl, out):
    # In the order of the columns of signals.GOVERNOR; a test holds it.
    out[0], out[1], out[2] = ctl.mode, ctl.cause, ctl.acting
    out[3], out[4], out[5], out[6] = ctl.tank, ctl.spring, ctl.budget, ctl.kinetic
    out[7], out[8], out[9] = ctl.damped, ctl.fed, ctl.posed
    out[10], out[11], out[12] = ctl.saturated, ctl.exerted, ctl.filled
    for a in range(6):
        out[13 + a] = ctl.wrench_command[a]
    out[19], out[20], out[21] = _norm(ctl.wrench, 0), _norm(ctl.wrench, 3), _norm(ctl.impact, 0)


@kernel
def _norm(vector, first):
    x, y, z = vector[first], vector[first + 1], vector[first + 2]
    return math.sqrt(x * x + y * y + z * z)


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
