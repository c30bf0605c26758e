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
from wrenchflow.sim.ft_sensor import SENSOR, read_sensor
from wrenchflow.sim.hold import HOLD, pull
from wrenchflow.sim.memory import floats_at
from wrenchflow.sim.row import record
from wrenchflow.so3 import exp_into, multiply_into, quat_into

TICK_NS = 1_000_000
WATCH_TICKS = np.int64(5)  # A referee looks at every fifth tick.
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

# Where a simulation lies in memory, what its measurement adds to the truth, and how far it is. One record, for what a
# compiled function is called with costs more in free space than what it does.
MEASURE = np.dtype(
    [
        ("model", "u8"),  # addresses: of mjModel, mjData, and in it
        ("data", "u8"),
        ("qpos", "u8"),  # (7,)
        ("qvel", "u8"),
        ("ctrl", "u8"),
        ("bias", "u8"),
        ("gravity", "u8"),
        ("constraint", "u8"),
        ("tcp_xpos", "u8"),  # (3,)
        ("tcp_xmat", "u8"),  # (9,)
        ("wrench", "u8"),  # (6,)
        ("tick", "i8"),  # ticks since the start of the clock
        ("tcp_site", "i8"),
        ("joint_position_noise", "f8"),  # [rad]
        ("joint_velocity_noise", "f8"),  # [rad/s]
        ("torque_noise", "f8"),  # [N.m]
        ("R_error", "f8", (3, 3)),  # constant calibration error of the TCP's orientation
        ("shift", "f8", 6),  # of the measured TCP, by the noise of the joints [m, rad]
        ("matrices", "f8", (3, 3, 3)),  # what a tick works with
        ("sensor", SENSOR),
        ("hold", HOLD),
    ],
    align=True,
)


# What a referee sees: the true TCP pose, and the wrench that the safety layer feels.
SEEN = np.dtype([("tcp_pose", "f8", 7), ("wrench", "f8", 6)], align=True)


def point_to(measure: np.ndarray, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Note in one `MEASURE` record where a simulation lies; it holds as long as `model` and `data` do."""
    record, site = measure[0], model.site("tcp").id
    record["tcp_site"], record["model"], record["data"] = site, model._address, data._address
    for name, array in (
        ("qpos", data.qpos),
        ("qvel", data.qvel),
        ("ctrl", data.ctrl),
        ("bias", data.qfrc_bias),
        ("gravity", data.qfrc_gravcomp),
        ("constraint", data.qfrc_constraint),
        ("tcp_xpos", data.site_xpos[site]),
        ("tcp_xmat", data.site_xmat[site]),
        ("wrench", data.sensordata),
    ):
        record[name] = array.ctypes.data
    flange = model.body("flange").id
    record["hold"]["force"] = data.xfrc_applied[flange].ctypes.data
    record["hold"]["centre"] = data.xipos[flange].ctypes.data


@kernel
def read(measure, white, index, obs):
    """The first half of a tick: kinematics and forces without control, then what is measured of them, into `obs`."""
    _mj_step1(measure[0].model, measure[0].data)
    observe(measure[0], white[index], obs[0])


@kernel
def write(measure, tau):
    """The second half of a tick: the torque acts, and one millisecond passes."""
    ctrl = floats_at(measure[0].ctrl, JOINTS)
    for j in range(JOINTS):
        ctrl[j] = tau[j]
    _mj_step2(measure[0].model, measure[0].data)


@kernel
def observe(measure, white, obs):
    """Fill `obs` from mjData after `mj_step1`, with the noise of the joints and the sensor.

    Noise of the joints moves the measured pose through the Jacobian, which is exact to second order in 0.05 mrad.
    """
    model, data = measure.model, measure.data
    qpos, qvel, ctrl = floats_at(measure.qpos, JOINTS), floats_at(measure.qvel, JOINTS), floats_at(measure.ctrl, JOINTS)
    bias, gravity = floats_at(measure.bias, JOINTS), floats_at(measure.gravity, JOINTS)
    constraint = floats_at(measure.constraint, JOINTS)
    tcp_xpos, tcp_xmat = floats_at(measure.tcp_xpos, 3), floats_at(measure.tcp_xmat, 9)
    J = obs.J
    _mj_jac_site(model, data, J.ctypes.data, J.ctypes.data + 3 * JOINTS * 8, measure.tcp_site)
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
        obs.x[i] = tcp_xpos[i] + shift[i]
        for j in range(3):
            R_true[i, j] = tcp_xmat[3 * i + j]
    exp_into(shift[3], shift[4], shift[5], step)
    multiply_into(step, R_true, turned)
    multiply_into(turned, measure.R_error, obs.R)
    read_sensor(floats_at(measure.wrench, 6), white, measure.sensor, obs.wrench)


@kernel
def witness(measure, ctl, seen):
    """Store what a referee sees of the tick that `read` began, if it is one that is looked at."""
    tick = measure.tick - 1
    if tick % WATCH_TICKS != 0:
        return
    row = seen[tick // WATCH_TICKS]
    xpos, xmat, R = floats_at(measure.tcp_xpos, 3), floats_at(measure.tcp_xmat, 9), measure.matrices[0]
    for i in range(3):
        row.tcp_pose[i] = xpos[i]
        for j in range(3):
            R[i, j] = xmat[3 * i + j]
    quat_into(R, row.tcp_pose[3:])
    for i in range(6):
        row.wrench[i] = ctl.wrench[i]


@kernel
def advance(measure, white, drawn, obs, req, schedule, ctl, rows, seen, first, count):
    """Run `count` ticks of measuring, controlling, stepping and recording, without Python and without the GIL.

    Args:
        measure: One `MEASURE` record.
        white: Standard normal numbers, one row a tick. Shape (n, NOISE_WIDTH).
        drawn: Index of the first of them to use.
        obs: One `OBS` record.
        req: One `REQ` record.
        schedule: One `SCHEDULE` record.
        ctl: One `CTL` record.
        rows: Where rows are stored, `ROW` records.
        seen: Where what a referee sees is stored, `SEEN` records.
        first: Index of the first row to write.
        count: Number of ticks.
    """
    for k in range(count):
        read(measure, white, drawn + k, obs)
        impedance.tick(obs[0], req[0], schedule[0], ctl[0])
        record(obs, ctl, rows, first + k)
        witness(measure[0], ctl[0], seen)
        pull(measure[0].hold, obs[0])
        write(measure, ctl[0].tau)
