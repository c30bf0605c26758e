"""One tick of control: gate, ledger, mode, target, stiffness, reference, law, limits; the law is the middle of it.

    tau = J^T (K e - D V + F_d) + N tau_null + c(q, dq),        e = [x_d - x ; log(R_d R^T)], world-aligned

Scalar loops over records, compiled; under `NUMBA_DISABLE_JIT=1` the same files are plain Python, bit for bit.
"""

import math

from wrenchflow.compiled import kernel
from wrenchflow.control.damping import design_damping
from wrenchflow.control.energy import account, available, error_into, raise_gain
from wrenchflow.control.felt import feel, length
from wrenchflow.control.gate import all_finite, fill, has_jumped, is_on, note, request_is_sound, state_is_sound
from wrenchflow.control.modes import OVER_BUDGET, decide_mode, enter
from wrenchflow.control.records import JOINTS
from wrenchflow.control.reference import govern_reference, speed_max
from wrenchflow.control.safeguards import (
    ARM_SPEED,
    FORCE_CAP,
    GATE_REQUEST,
    GATE_STATE,
    GATE_TORQUE,
    HOLD,
    LATCHED,
    MOMENT_CAP,
    NO_CAUSE,
    OBSERVER,
    RETREAT,
    RUN,
    SOFT_STOP,
    TANK_TORQUE,
    TORQUE_RATE,
)
from wrenchflow.control.schedule import clear, evaluate
from wrenchflow.control.stiffness import TICK_S, clamp_stiffness, govern_stiffness
from wrenchflow.control.torque import cap_norm, limit_torque
from wrenchflow.so3 import exp_into, multiply_into

_TAKEN_MAX = 0.5  # Share of the arm's kinetic energy that damping may take while it is let go of.
_FADE_FROM = 0.5  # Of the speed at which the arm is braked: from it on feed-forward fades out.


@kernel
def start(obs, schedule, ctl):
    """Begin where the arm is, waiting: the reference, the target and the nullspace posture are the measured ones.

    The torque goes on from the last command, at its rate limit: whoever starts again may be pressing.
    """
    clear(schedule)
    ctl.tick = ctl.mode_tick = ctl.segment_tick = ctl.silent_ticks = 0
    ctl.mode, ctl.cause, ctl.is_waiting = HOLD, NO_CAUSE, 1
    ctl.is_asked = ctl.was_asked = ctl.is_refused = ctl.is_fresh = ctl.is_stop_asked = 0
    ctl.follows_plan = ctl.pending = ctl.acting = 0
    ctl.gain = ctl.spring = 0.0
    ctl.tank = ctl.tank_start
    ctl.budget = ctl.tank_start
    fill(ctl.over_ticks, 0)
    fill(ctl.frozen_ticks, 0)
    ctl.dead_ticks = 0
    ctl.retreat_ns = obs.t_ns  # A plan that was made before this start knows nothing of it.
    # A reading that no sensor gives would ring on in the low-passes.
    fill(ctl.wrench_state, 0.0)
    fill(ctl.impact_state, 0.0)
    fill(ctl.wrench, 0.0)
    fill(ctl.impact, 0.0)
    for i in range(3):
        ctl.x_d[i] = ctl.x_target[i] = obs.x[i]
        ctl.x_offset[i] = 0.0
        for j in range(3):
            ctl.R_d[i, j] = ctl.R_target[i, j] = obs.R[i, j]
            ctl.K_lin_target[i, j], ctl.K_rot_target[i, j] = ctl.K_lin[i, j], ctl.K_rot[i, j]
    ctl.damping_ratio_target = ctl.damping_ratio
    fill(ctl.wrench_target, 0.0)
    fill(ctl.wrench_command, 0.0)
    ctl.gripper_target = math.nan
    for j in range(JOINTS):
        ctl.q_null[j] = ctl.q_last[j] = obs.q[j]
        ctl.tau_spring[j] = ctl.tau_damping[j] = ctl.tau_fed[j] = ctl.tau_posed[j] = 0.0


@kernel
def tick(obs, req, schedule, ctl):
    """Decide the torque of one tick into `ctl.tau` [N.m], without gravity.

    A state that cannot be, or a torque that is not finite, latches: the command goes, at the rate limit, to what brakes
    every joint, or to zero while the state cannot be read. Gravity stays compensated by the robot.
    """
    ctl.acting, ctl.pending = ctl.pending, 0
    fill(ctl.tau_wanted, 0.0)
    can_be = state_is_sound(obs)
    is_sound = can_be and not has_jumped(obs, ctl)
    if not is_sound and is_on(ctl, GATE_STATE) and ctl.mode != LATCHED:
        enter(ctl, LATCHED, GATE_STATE)
    if is_sound:
        feel(obs, ctl)
        if ctl.tick > 0:
            account(obs, ctl)
        else:
            error_into(ctl, obs.x, obs.R)
        _read_request(req, ctl)
        decide_mode(obs, schedule, ctl)
    if ctl.mode != LATCHED:
        _decide_torque(obs, req, schedule, ctl)
        if not all_finite(ctl.tau_wanted) and is_on(ctl, GATE_TORQUE):
            enter(ctl, LATCHED, GATE_TORQUE)
    if ctl.mode == LATCHED:
        _brake(obs, ctl, is_sound)
    limit_torque(ctl)
    if can_be:
        ctl.t_last_ns = obs.t_ns
        for j in range(JOINTS):
            ctl.q_last[j] = obs.q[j]
    ctl.tick += 1
    _count(ctl)


@kernel
def tick_each(obs, req, schedule, ctl):
    """One tick of a batch of controllers, arrays of records; also the quick way in from Python for one of them.

    Numba takes ten times as long to look at a record as at an array.
    """
    for i in range(ctl.shape[0]):
        tick(obs[i], req[i], schedule[i], ctl[i])


@kernel
def _count(ctl):
    acting, number = ctl.acting, 0
    while acting:
        ctl.counts[number] += acting & 1
        acting >>= 1
        number += 1


@kernel
def _read_request(req, ctl):
    """A segment that is not sound is counted and not followed: what was asked before stays, with its patience."""
    is_asked, was_refused = ctl.is_asked, ctl.is_refused
    ctl.is_asked = ctl.is_refused = 0
    if is_asked:
        ctl.was_asked = 1
    if ctl.mode == SOFT_STOP or ctl.mode == LATCHED or not ctl.was_asked or (ctl.follows_plan and not is_asked):
        return
    if is_on(ctl, GATE_REQUEST) and not request_is_sound(req):
        note(ctl, GATE_REQUEST)
        ctl.is_refused = 1
        if is_asked or not was_refused:
            ctl.rejected += 1
    elif is_asked:
        ctl.is_fresh, ctl.follows_plan, ctl.segment_tick = 1, 0, 0
        ctl.patience_ticks = req.patience_ticks


@kernel
def _decide_torque(obs, req, schedule, ctl):
    if ctl.mode == RUN and ctl.follows_plan:
        evaluate(schedule, obs.t_ns, ctl)
    elif ctl.mode == RUN and not ctl.is_refused:
        _follow_segment(req, ctl)
    if ctl.mode == SOFT_STOP:
        ctl.gain = max(0.0, ctl.gain - ctl.stop_step)
        fill(ctl.wrench_target, 0.0)
    else:
        raise_gain(ctl)
        govern_stiffness(ctl)
        if ctl.tick % ctl.design_ticks == 0:
            design_damping(obs.J, obs.M, ctl.K_lin, ctl.K_rot, ctl.damping_ratio, ctl.D, ctl.P, ctl.inertia)
    govern_reference(obs, ctl, ctl.mode == RUN or ctl.mode == RETREAT)
    _law(obs, ctl)


@kernel
def _follow_segment(req, ctl):
    """The target of this tick: along the segment, then at its end."""
    if ctl.segment_tick == 0:
        for i in range(3):
            ctl.x_offset_start[i] = ctl.x_offset[i]
    ctl.segment_tick += 1
    share = 1.0 if ctl.segment_tick >= req.ticks else ctl.segment_tick / req.ticks
    step = ctl.matrices[0]
    exp_into(share * req.turn[0], share * req.turn[1], share * req.turn[2], step)
    multiply_into(step, req.R_start, ctl.R_target)
    for i in range(3):
        ctl.x_target[i] = req.x_start[i] + share * (req.x_stop[i] - req.x_start[i])
        ctl.x_offset[i] = ctl.x_offset_start[i] + share * (req.x_offset[i] - ctl.x_offset_start[i])
        ctl.wrench_target[i], ctl.wrench_target[3 + i] = req.wrench[i], req.wrench[3 + i]
        for j in range(3):
            ctl.K_lin_target[i, j], ctl.K_rot_target[i, j] = req.K_lin[i, j], req.K_rot[i, j]
    ctl.damping_ratio_target = req.damping_ratio
    ctl.gripper_target = math.nan


@kernel
def _law(obs, ctl):
    """The torque before its limits, with each part of it apart for the ledger; `ctl.e` is the reference's."""
    e, V, F = ctl.e, ctl.V, ctl.F
    for a in range(6):
        s = 0.0
        for j in range(JOINTS):
            s += obs.J[a, j] * obs.dq[j]
        V[a] = s
    _add_posture(obs, ctl)
    _feed_forward(obs, ctl)
    for i in range(3):
        linear, angular = 0.0, 0.0
        for j in range(3):
            linear += ctl.K_lin[i, j] * e[j]
            angular += ctl.K_rot[i, j] * e[3 + j]
        F[i], F[3 + i] = ctl.gain * linear, ctl.gain * angular
    fill(ctl.tau_spring, 0.0)
    _add_torque(obs, F, ctl.tau_spring)
    if ctl.mode == SOFT_STOP:  # Nothing pays for it any more: what the spring still does, it does from its own.
        ctl.spring = 0.5 * (F[0] * e[0] + F[1] * e[1] + F[2] * e[2] + F[3] * e[3] + F[4] * e[4] + F[5] * e[5])
    _cap(obs, ctl)
    _damp(obs, ctl)
    for j in range(JOINTS):
        ctl.tau_wanted[j] += ctl.tau_spring[j] + ctl.tau_fed[j] + ctl.tau_damping[j] + ctl.tau_posed[j]


@kernel
def _add_torque(obs, F, tau):
    """Add J^T F to a torque."""
    for j in range(JOINTS):
        s = 0.0
        for a in range(6):
            s += obs.J[a, j] * F[a]
        tau[j] += s


@kernel
def _payable(ctl, cost):
    """The share, up to 1, of a work [J] in the coming tick that the tank can pay for."""
    if cost <= available(ctl) or not is_on(ctl, TANK_TORQUE):
        return 1.0
    note(ctl, TANK_TORQUE)
    return available(ctl) / cost


@kernel
def _add_posture(obs, ctl):
    """Nullspace and Coriolis torque into `tau_posed`.

    The nullspace pulls back to the starting posture; what of it would move the TCP is taken out through P.
    """
    posture, F = ctl.posture, ctl.F
    root = 2.0 * math.sqrt(ctl.null_stiffness)
    share = ctl.gain if ctl.mode == SOFT_STOP else 1.0
    for j in range(JOINTS):
        posture[j] = share * (ctl.null_stiffness * (ctl.q_null[j] - obs.q[j]) - root * obs.dq[j])
    for a in range(6):
        s = 0.0
        for j in range(JOINTS):
            s -= ctl.P[a, j] * posture[j]
        F[a] = s
    _add_torque(obs, F, posture)
    power = 0.0
    for j in range(JOINTS):
        power += posture[j] * obs.dq[j]
    share = _payable(ctl, power * TICK_S)
    for j in range(JOINTS):
        ctl.tau_posed[j] = share * posture[j] + obs.coriolis[j]


@kernel
def _feed_forward(obs, ctl):
    """Feed-forward wrench as far as the caps, the arm's speed and the tank allow, into `wrench_command`."""
    F, power, asked = ctl.wrench_command, 0.0, False
    for a in range(6):
        F[a] = ctl.wrench_target[a]
        asked = asked or F[a] != 0.0
    if not asked or ctl.mode != RUN:
        fill(F, 0.0)
        return
    for a in range(6):
        F[a] *= ctl.gain
    if is_on(ctl, FORCE_CAP) and cap_norm(F, 0, ctl.force_max):
        note(ctl, FORCE_CAP)
    if is_on(ctl, MOMENT_CAP) and cap_norm(F, 3, ctl.moment_max):
        note(ctl, MOMENT_CAP)
    for a in range(6):
        power += F[a] * ctl.V[a]
    share = _payable(ctl, power * TICK_S)
    if power > 0.0 and is_on(ctl, ARM_SPEED):
        # It fades out towards the speed at which the arm is braked: both would only pull at each other.
        fastest = ctl.arm_speed_share * speed_max(ctl, obs.x)
        over = length(ctl.V, 0) * TICK_S / fastest
        over = max(over, length(ctl.V, 3) * TICK_S / (fastest / ctl.x_step_max * ctl.turn_step_max))
        if over > _FADE_FROM:
            note(ctl, ARM_SPEED)
            share *= max(0.0, (1.0 - over) / (1.0 - _FADE_FROM))
    for a in range(6):
        F[a] *= share


@kernel
def _cap(obs, ctl):
    """Cap the force of spring and feed-forward together; the ledger keeps what the cap took away apart."""
    F, asked = ctl.F, ctl.sample
    fill(ctl.tau_fed, 0.0)
    _add_torque(obs, ctl.wrench_command, ctl.tau_fed)
    for a in range(6):
        F[a] += ctl.wrench_command[a]
        asked[a] = F[a]
    capped = False
    if is_on(ctl, FORCE_CAP) and cap_norm(F, 0, ctl.force_max):
        note(ctl, FORCE_CAP)
        capped = True
    if is_on(ctl, MOMENT_CAP) and cap_norm(F, 3, ctl.moment_max):
        note(ctl, MOMENT_CAP)
        capped = True
    if capped:
        for a in range(6):
            F[a] -= asked[a]
        _add_torque(obs, F, ctl.tau_wanted)


@kernel
def _damp(obs, ctl):
    """Damping into `tau_damping`: the law's, the brake of an arm that is too fast, and the stops'.

    The law's is at full strength from the first tick: the ramp is there to be gentle, not to let the arm swing.
    """
    F, V = ctl.F, ctl.V
    for a in range(6):
        s = 0.0
        for b in range(6):
            s -= ctl.D[a, b] * V[b]
        F[a] = s
    if is_on(ctl, ARM_SPEED):
        step = ctl.arm_speed_share * speed_max(ctl, obs.x)
        _brake_excess(ctl, 0, step / TICK_S)
        _brake_excess(ctl, 3, step / ctl.x_step_max * ctl.turn_step_max / TICK_S)
    fill(ctl.tau_damping, 0.0)
    _add_torque(obs, F, ctl.tau_damping)
    if is_on(ctl, TORQUE_RATE) and ctl.budget >= 0.0:  # Over budget, what brakes at all brakes with all it has.
        _let_go_in_time(obs, ctl)
    brake = ctl.brake * (1.0 - ctl.gain) if ctl.mode == SOFT_STOP else 0.0
    if ctl.budget < 0.0 and is_on(ctl, OBSERVER):
        note(ctl, OBSERVER)
        brake += ctl.observer_damping
        ctl.over_ticks[OVER_BUDGET] += 1
        if ctl.over_ticks[OVER_BUDGET] > ctl.overdraft_ticks_max:
            enter(ctl, LATCHED, OBSERVER)
    else:
        ctl.over_ticks[OVER_BUDGET] = 0
    if brake > 0.0:
        for j in range(JOINTS):
            ctl.tau_damping[j] -= brake * _seen_speed(obs, ctl, j)


@kernel
def _let_go_in_time(obs, ctl):
    """Damp no harder than can be let go of, at the limited rate of torque, by the time the arm has come to rest.

    Falling evenly to zero, the damping takes half its present power times that time out of the motion. If that is more
    than there is, the arm turns round before the torque does, and is driven by its own brake.
    """
    power, kinetic, ticks = 0.0, 0.0, 0.0
    for j in range(JOINTS):
        power -= ctl.tau_damping[j] * obs.dq[j]
        ticks = max(ticks, abs(ctl.tau_damping[j]) / ctl.tau_step_max[j])
        for k in range(JOINTS):
            kinetic += 0.5 * obs.dq[j] * obs.M[j, k] * obs.dq[k]
    taken, most = 0.5 * power * ticks * TICK_S, _TAKEN_MAX * kinetic
    if taken > most:
        note(ctl, TORQUE_RATE)
        share = math.sqrt(most / taken)
        for j in range(JOINTS):
            ctl.tau_damping[j] *= share


@kernel
def _seen_speed(obs, ctl, j):
    """How fast a joint surely turns: as it says, and as it has moved since the last tick; 0 where these disagree.

    A joint that says that it turns and does not would be driven by its own brake.
    """
    said, moved = obs.dq[j], (obs.q[j] - ctl.q_last[j]) / TICK_S
    if said * moved <= 0.0:
        return 0.0
    return said if abs(said) < abs(moved) else moved


@kernel
def _brake_excess(ctl, first, fastest):
    """Damp what three entries of the twist have over a speed, by the inertia that is felt there."""
    speed = length(ctl.V, first)
    if speed <= fastest:
        return
    note(ctl, ARM_SPEED)
    rate = ctl.brake_rate * (1.0 - fastest / speed)
    for i in range(first, first + 3):
        for j in range(first, first + 3):
            ctl.F[i] -= rate * ctl.inertia[i, j] * ctl.V[j]


@kernel
def _brake(obs, ctl, is_sound):
    """Latched: every joint is braked, or nothing is done while the state cannot be read; the spring is let go."""
    ctl.gain = ctl.spring = 0.0
    fill(ctl.wrench_command, 0.0)
    for j in range(JOINTS):
        ctl.tau_damping[j] = -ctl.brake * _seen_speed(obs, ctl, j) if is_sound else 0.0
        ctl.tau_spring[j] = ctl.tau_fed[j] = ctl.tau_posed[j] = 0.0
        ctl.tau_wanted[j] = ctl.tau_damping[j]


@kernel
def clamp_both(ctl):
    """Take the stiffness and the damping ratio that are asked for at once, within their range: for the start only."""
    clamp_stiffness(ctl.K_lin_target, ctl.K_lin_min, ctl.K_lin_max, ctl.K_lin)
    clamp_stiffness(ctl.K_rot_target, ctl.K_rot_min, ctl.K_rot_max, ctl.K_rot)
    ctl.damping_ratio = min(max(ctl.damping_ratio_target, ctl.damping_ratio_min), ctl.damping_ratio_max)
