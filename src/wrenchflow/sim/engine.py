"""MuJoCo called from inside a compiled loop: one tick of reading, control, stepping and recording, many times.

`mj_step1`, law, `mj_step2`: the pose in a row is that of its own tick; the wrench and the external torque are the last
tick's, because MuJoCo computes forces in `mj_step2`. They are stamped so.
"""

import os

import llvmlite.binding
import mujoco
import numpy as np
from numba import types

from wrenchflow.compiled import kernel
from wrenchflow.control import impedance
from wrenchflow.control.records import JOINTS
from wrenchflow.sim.ft_sensor import read_sensor
from wrenchflow.so3 import exp_into, multiply_into, quat_into

TICK_NS = 1_000_000
EPOCH_NS = 1_577_836_800_000_000_000  # Where virtual time begins, 2020-01-01: no wall time is in any file.
NOISE_WIDTH = 6 + 4 * JOINTS  # sensor, joint position, joint velocity, torque, external torque

_folder = os.path.dirname(mujoco.__file__)
_library = next(name for name in sorted(os.listdir(_folder)) if name.startswith(("libmujoco", "mujoco.dll")))
# By name and not by address, so that compiled loops can be kept in numba's cache.
llvmlite.binding.load_library_permanently(os.path.join(_folder, _library))
_mj_step1 = types.ExternalFunction("mj_step1", types.void(types.uintp, types.uintp))
_mj_step2 = types.ExternalFunction("mj_step2", types.void(types.uintp, types.uintp))
_mj_full_inertia = types.ExternalFunction("mj_fullM", types.void(types.uintp, types.uintp, types.uintp))
_mj_jac_site = types.ExternalFunction(
    "mj_jacSite", types.void(types.uintp, types.uintp, types.uintp, types.uintp, types.intc)
)

# One row a tick. Poses are x y z, then wxyz with a sign that does not flip from row to row.
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

# What the measurement adds to the truth, and where the TCP is.
MEASURE = np.dtype(
    [
        ("tick", "i8"),  # ticks since the start of the clock
        ("tcp_site", "i8"),
        ("joint_position_noise", "f8"),  # [rad]
        ("joint_velocity_noise", "f8"),  # [rad/s]
        ("torque_noise", "f8"),  # [N.m]
        ("R_error", "f8", (3, 3)),  # constant calibration error of the TCP's orientation
        ("shift", "f8", 6),  # of the measured TCP, by the noise of the joints [m, rad]
        ("matrices", "f8", (3, 3, 3)),  # what a tick works with
    ],
    align=True,
)


@kernel
def read(model, data, views, measure, sensors, white, obs):
    """The first half of a tick: kinematics and forces without control, then what is measured of them, into `obs`."""
    _mj_step1(model, data)
    observe(model, data, views, measure[0], sensors[0], white, obs[0])


@kernel
def observe(model, data, views, measure, sensor, white, obs):
    """Fill `obs` from mjData after `mj_step1`, with the noise of the joints and the sensor.

    Noise of the joints moves the measured pose through the Jacobian, which is exact to second order in 0.05 mrad.
    """
    qpos, qvel, ctrl, bias, gravity, constraint, site_xpos, site_xmat, sensordata = views
    site = measure.tcp_site
    J = obs.J
    _mj_jac_site(model, data, J.ctypes.data, J.ctypes.data + 3 * JOINTS * 8, site)
    _mj_full_inertia(model, data, obs.M.ctypes.data)
    obs.t_ns = EPOCH_NS + measure.tick * TICK_NS
    measure.tick += 1
    shift, R_true, step, turned = measure.shift, measure.matrices[0], measure.matrices[1], measure.matrices[2]
    shift[:] = 0.0
    for j in range(JOINTS):
        noise = measure.joint_position_noise * white[6 + j]
        obs.q[j] = qpos[j] + noise
        obs.dq[j] = qvel[j] + measure.joint_velocity_noise * white[6 + JOINTS + j]
        obs.tau[j] = ctrl[j] + measure.torque_noise * white[6 + 2 * JOINTS + j]
        # Constraint forces are what the environment does to the arm; measured minus modelled has the other sign.
        obs.tau_external[j] = -constraint[j] + measure.torque_noise * white[6 + 3 * JOINTS + j]
        obs.coriolis[j] = bias[j] - gravity[j]
        for a in range(6):
            shift[a] += J[a, j] * noise
    for i in range(3):
        obs.x[i] = site_xpos[site, i] + shift[i]
        for j in range(3):
            R_true[i, j] = site_xmat[site, 3 * i + j]
    exp_into(shift[3], shift[4], shift[5], step)
    multiply_into(step, R_true, turned)
    multiply_into(turned, measure.R_error, obs.R)
    read_sensor(sensordata, white, sensor, obs.wrench)


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


@kernel
def advance(model, data, views, measure, sensors, white, obs, req, ctl, rows, first, count):
    """Run `count` ticks of measuring, controlling, stepping and recording, without Python and without the GIL.

    Args:
        model: Address of the mjModel.
        data: Address of the mjData.
        views: Arrays over mjData's memory, in the order of `Plant.views`.
        measure: One `MEASURE` record.
        sensors: One `SENSOR` record.
        white: Standard normal numbers, one row a tick. Shape (count, NOISE_WIDTH).
        obs: One `OBS` record.
        req: One `REQ` record.
        ctl: One `CTL` record.
        rows: Where rows are stored, `ROW` records.
        first: Index of the first row to write.
        count: Number of ticks.
    """
    ctrl = views[2]
    for k in range(count):
        read(model, data, views, measure, sensors, white[k], obs)
        impedance.tick(obs[0], req[0], ctl[0])
        for j in range(JOINTS):
            ctrl[j] = ctl[0].tau[j]
        record(obs, ctl, rows, first + k)
        _mj_step2(model, data)
