"""The impedance law, one tick: F = K e - D V, tau = J^T F + nullspace + Coriolis, behind the governor.

Scalar loops over three records, compiled; under `NUMBA_DISABLE_JIT=1` the same file is plain Python, bit for bit.
"""

import math

from wrenchflow.compiled import kernel
from wrenchflow.control.damping import design_damping
from wrenchflow.control.governor import (
    all_finite,
    cap_norm,
    leash_position,
    leash_rotation,
    limit_stiffness,
    limit_torque,
    request_is_sound,
    state_is_finite,
)
from wrenchflow.control.records import FAULT_NONE, FAULT_STATE, FAULT_TORQUE, JOINTS
from wrenchflow.so3 import exp_into, log_into, multiply_into, multiply_transposed_into

BRAKE_NM_S_RAD = 10.0  # After a fault: stops the arm in half a second, and is no match for a hand.


@kernel
def start(obs, ctl):
    """Begin where the arm is: the reference, the target and the nullspace posture are the measured ones.

    The torque goes on from the last command, at its rate limit: whoever starts again may be pressing. A fault is
    cleared.
    """
    ctl.tick = 0
    ctl.segment_tick = 0
    ctl.rejected = 0
    ctl.fault = FAULT_NONE
    for i in range(3):
        ctl.x_d[i] = obs.x[i]
        ctl.x_target[i] = obs.x[i]
        ctl.x_offset[i] = 0.0
        for j in range(3):
            ctl.R_d[i, j] = obs.R[i, j]
            ctl.R_target[i, j] = obs.R[i, j]
    for i in range(JOINTS):
        ctl.q_null[i] = obs.q[i]


@kernel
def tick(obs, req, ctl):
    """Decide the torque of one tick into `ctl.tau` [N.m], without gravity.

    A request that is not sound is counted and not followed: the last target stays. A state or a torque that is not
    finite latches a fault: the command goes, at the rate limit, to what brakes every joint, or to zero while the state
    cannot be read. Gravity stays compensated by the robot.
    """
    ctl.tau_wanted[:] = 0.0
    is_finite = state_is_finite(obs)
    if not is_finite:
        ctl.fault = FAULT_STATE
    if ctl.fault == FAULT_NONE:
        _take_request(req, ctl)
        leash_position(ctl, obs.x)
        leash_rotation(ctl, obs.R)
        if ctl.tick % ctl.design_ticks == 0:
            design_damping(obs.J, obs.M, ctl.K_lin, ctl.K_rot, ctl.damping_ratio, ctl.D, ctl.P)
        _law(obs, ctl)
        if not all_finite(ctl.tau_wanted):
            ctl.fault = FAULT_TORQUE
    if ctl.fault != FAULT_NONE:
        for j in range(JOINTS):
            ctl.tau_wanted[j] = -BRAKE_NM_S_RAD * obs.dq[j] if is_finite else 0.0
    limit_torque(ctl)
    ctl.tick += 1


@kernel
def tick_each(obs, req, ctl):
    """One tick of a batch of controllers, arrays of records; also the quick way in from Python for one of them.

    Numba takes ten times as long to look at a record as at an array.
    """
    for i in range(ctl.shape[0]):
        tick(obs[i], req[i], ctl[i])


@kernel
def _take_request(req, ctl):
    if not request_is_sound(req):
        ctl.rejected += 1
        return
    ctl.segment_tick += 1
    share = 1.0 if ctl.segment_tick >= req.ticks else ctl.segment_tick / req.ticks
    step = ctl.matrices[0]
    exp_into(share * req.turn[0], share * req.turn[1], share * req.turn[2], step)
    multiply_into(step, req.R_start, ctl.R_target)
    for i in range(3):
        ctl.x_target[i] = req.x_start[i] + share * (req.x_stop[i] - req.x_start[i])
        ctl.x_offset[i] = req.x_offset[i]
    limit_stiffness(req.K_lin, ctl.K_lin_max, ctl.K_lin)
    limit_stiffness(req.K_rot, ctl.K_rot_max, ctl.K_rot)
    ctl.damping_ratio = min(req.damping_ratio, ctl.damping_ratio_max)


@kernel
def _law(obs, ctl):
    # e = [x_d - x ; log(R_d R^T)], world-aligned.
    e, V, F, posture = ctl.e, ctl.V, ctl.F, ctl.posture
    multiply_transposed_into(ctl.R_d, obs.R, ctl.matrices[0])
    log_into(ctl.matrices[0], ctl.vector)
    for i in range(3):
        e[i], e[3 + i] = ctl.x_d[i] - obs.x[i], ctl.vector[i]
    for a in range(6):
        s = 0.0
        for j in range(JOINTS):
            s += obs.J[a, j] * obs.dq[j]
        V[a] = s
    gain = min(1.0, ctl.tick / ctl.ramp_ticks) if ctl.ramp_ticks > 0 else 1.0
    for i in range(3):
        linear, angular = 0.0, 0.0
        for j in range(3):
            linear += ctl.K_lin[i, j] * e[j]
            angular += ctl.K_rot[i, j] * e[3 + j]
        F[i], F[3 + i] = gain * linear, gain * angular
    cap_norm(F, 0, ctl.force_max)
    cap_norm(F, 3, ctl.moment_max)
    # Damping is at full strength from the first tick: the ramp is there to be gentle, not to let the arm swing.
    for a in range(6):
        s = 0.0
        for b in range(6):
            s += ctl.D[a, b] * V[b]
        F[a] -= s
    # The nullspace pulls back to the starting posture; what of it would move the TCP is taken out through F.
    root = 2.0 * math.sqrt(ctl.null_stiffness)
    for j in range(JOINTS):
        posture[j] = ctl.null_stiffness * (ctl.q_null[j] - obs.q[j]) - root * obs.dq[j]
    for a in range(6):
        s = 0.0
        for j in range(JOINTS):
            s += ctl.P[a, j] * posture[j]
        F[a] -= s
    for j in range(JOINTS):
        s = posture[j] + obs.coriolis[j]
        for a in range(6):
            s += obs.J[a, j] * F[a]
        ctl.tau_wanted[j] = s
