"""The state machine: RUN, HOLD, RETREAT, SOFT_STOP, LATCHED, and what leads from one to another.

    waiting -> RUN         something was asked for the first time
    RUN     -> HOLD        no plan came in time, or the plan is used up; a fresh one leads back
    HOLD    -> SOFT_STOP   after a second of it
    any     -> RETREAT     pressed too hard: let go, 5 mm away from the contact, then HOLD
    any     -> SOFT_STOP   hit, joint near its limit, loop late, clock wrong, sensor dead: stiffness falls to zero
    SOFT_STOP -> LATCHED   joints are braked until the operator resets
    any     -> LATCHED     emergency stop, nothing finite, more work done than budgeted

A state is only ever left for one further down, but for RETREAT and HOLD.
"""

import math

import numpy as np

from wrenchflow.compiled import kernel
from wrenchflow.control.energy import set_spring
from wrenchflow.control.felt import length
from wrenchflow.control.gate import fill, is_on, note
from wrenchflow.control.joint_speed import speed_limit
from wrenchflow.control.records import JOINTS
from wrenchflow.control.safeguards import (
    EMERGENCY_STOP,
    FORCE,
    HOLD,
    HOLD_EXPIRED,
    IMPACT,
    JOINT_LIMIT,
    JOINT_SPEED,
    LATCHED,
    MOMENT,
    NO_CAUSE,
    OVERRUN,
    PLAN_END,
    RETREAT,
    RUN,
    SENSOR,
    SILENCE,
    SOFT_STOP,
    STALE_STATE,
)

# Places in CTL.over_ticks.
OVER_FORCE, OVER_MOMENT, OVER_BUDGET, OVERRUNS, STALE = np.arange(5)
_MOVES_OUT_RAD_S = 0.01  # Less is the noise of a joint at rest.
_ARRIVED_M = 1e-4
_LEAST_N = 1.0  # A force that is smaller has no direction to retreat along.


@kernel
def enter(ctl, mode, cause):
    """Change to a mode, and remember which safeguard did it."""
    ctl.mode, ctl.cause, ctl.mode_tick = mode, cause, 0
    ctl.is_waiting = 0
    if cause != NO_CAUSE:
        note(ctl, cause)


@kernel
def decide_mode(obs, schedule, ctl):
    """Settle which mode this tick is in, from a state that is finite."""
    ctl.mode_tick += 1
    ctl.silent_ticks += 1
    if ctl.is_stop_asked and ctl.mode != LATCHED and is_on(ctl, EMERGENCY_STOP):
        enter(ctl, LATCHED, EMERGENCY_STOP)
    if ctl.mode == LATCHED:
        return
    if ctl.mode == SOFT_STOP:
        if ctl.gain <= 0.0:
            cause = ctl.cause
            enter(ctl, LATCHED, cause)
        return
    cause = _reason_to_stop(obs, ctl)
    if cause == NO_CAUSE and ctl.mode == RETREAT:
        cause = _retreat_on(obs, ctl)
    elif cause == NO_CAUSE:
        _look_at_force(obs, ctl)
    if cause != NO_CAUSE:
        enter(ctl, SOFT_STOP, cause)
    elif ctl.mode == HOLD or ctl.mode == RUN:
        _follow_or_hold(obs, schedule, ctl)


@kernel
def _follow_or_hold(obs, schedule, ctl):
    if ctl.is_fresh:
        ctl.is_fresh, ctl.silent_ticks = 0, 0
        if ctl.mode == HOLD:
            enter(ctl, RUN, NO_CAUSE)
    if ctl.mode == RUN:
        if ctl.patience_ticks > 0 and ctl.silent_ticks > ctl.patience_ticks and is_on(ctl, SILENCE):
            _hold(ctl, SILENCE)
        elif ctl.follows_plan and obs.t_ns > schedule.end_ns and is_on(ctl, PLAN_END):
            _hold(ctl, PLAN_END)
    elif not ctl.is_waiting and ctl.mode_tick > ctl.hold_ticks_max and is_on(ctl, HOLD_EXPIRED):
        enter(ctl, SOFT_STOP, HOLD_EXPIRED)


@kernel
def _hold(ctl, cause):
    """Freeze the reference, the stiffness and the damping ratio as they are; from then on that is what is asked."""
    enter(ctl, HOLD, cause)
    ctl.damping_ratio_target = ctl.damping_ratio
    for i in range(3):
        ctl.x_target[i] = ctl.x_d[i]
        ctl.x_offset[i] = 0.0
        ctl.wrench_target[i] = ctl.wrench_target[3 + i] = 0.0
        for j in range(3):
            ctl.R_target[i, j] = ctl.R_d[i, j]
            ctl.K_lin_target[i, j], ctl.K_rot_target[i, j] = ctl.K_lin[i, j], ctl.K_rot[i, j]


@kernel
def _counted(ctl, place, is_over):
    """For how many ticks in a row something has been so."""
    ctl.over_ticks[place] = ctl.over_ticks[place] + 1 if is_over else 0
    return ctl.over_ticks[place]


@kernel
def _look_at_force(obs, ctl):
    force = _counted(ctl, OVER_FORCE, length(ctl.wrench, 0) > ctl.retreat_force)
    moment = _counted(ctl, OVER_MOMENT, length(ctl.wrench, 3) > ctl.retreat_moment)
    if force >= ctl.retreat_patience_ticks and is_on(ctl, FORCE):
        _retreat(obs, ctl, FORCE)
    elif moment >= ctl.retreat_patience_ticks and is_on(ctl, MOMENT):
        _retreat(obs, ctl, MOMENT)


@kernel
def _retreat(obs, ctl, cause):
    """Let go, and ask for a place a little away from the contact, against what the robot exerts."""
    _hold(ctl, cause)
    enter(ctl, RETREAT, cause)
    ctl.over_ticks[OVER_FORCE] = ctl.over_ticks[OVER_MOMENT] = 0
    force = length(ctl.wrench, 0)
    for i in range(3):
        ctl.x_retreat[i] = obs.x[i] - (ctl.retreat_m * ctl.wrench[i] / force if force > _LEAST_N else 0.0)
        ctl.x_d[i] = obs.x[i]
        ctl.x_target[i] = ctl.x_retreat[i]
        for j in range(3):
            ctl.R_d[i, j] = ctl.R_target[i, j] = obs.R[i, j]
    fill(ctl.e, 0.0)
    set_spring(ctl, 0.0)


@kernel
def _retreat_on(obs, ctl):
    """Stay in a retreat until it has arrived and helped; a reason to stop if it does not.

    A moment without a force has no direction to go away in: letting go of the spring is all there is to do.
    """
    away, pressed = 0.0, NO_CAUSE
    for i in range(3):
        away += (ctl.x_d[i] - ctl.x_retreat[i]) ** 2
    if length(ctl.wrench, 0) > ctl.retreat_force and is_on(ctl, FORCE):
        pressed = FORCE
    elif length(ctl.wrench, 3) > ctl.retreat_moment and is_on(ctl, MOMENT):
        pressed = MOMENT
    if ctl.mode_tick <= ctl.retreat_ticks_max:
        if math.sqrt(away) > _ARRIVED_M:
            return NO_CAUSE
        if pressed != NO_CAUSE:
            note(ctl, pressed)
            return NO_CAUSE
    if pressed != NO_CAUSE:
        return pressed
    cause = ctl.cause
    _hold(ctl, cause)
    # What was asked before does not count as asked again.
    ctl.is_fresh = 0
    ctl.retreat_ns = obs.t_ns
    return NO_CAUSE


@kernel
def _reason_to_stop(obs, ctl):
    """The safeguard that asks for a soft stop, or NO_CAUSE."""
    if ctl.tick > 0:
        step_ns = obs.t_ns - ctl.t_last_ns
        stale = _counted(ctl, STALE, step_ns <= 0)
        if (step_ns < 0 or stale > ctl.stale_ticks_max) and is_on(ctl, STALE_STATE):
            return STALE_STATE
        late = _counted(ctl, OVERRUNS, step_ns > ctl.overrun_ns)
        if (step_ns > ctl.overrun_max_ns or late >= ctl.overruns_max) and is_on(ctl, OVERRUN):
            return OVERRUN
    is_frozen = False
    for i in range(6):
        is_frozen = is_frozen or 0 < ctl.frozen_ticks_max < ctl.frozen_ticks[i]
    if (is_frozen or ctl.dead_ticks > ctl.dead_ticks_max) and is_on(ctl, SENSOR):
        return SENSOR
    if length(ctl.impact, 0) > ctl.impact_force and is_on(ctl, IMPACT):
        return IMPACT
    for j in range(JOINTS):
        out = max(obs.q[j] - (ctl.q_max[j] - ctl.q_margin), (ctl.q_min[j] + ctl.q_margin) - obs.q[j])
        outward = obs.dq[j] if obs.q[j] > 0.5 * (ctl.q_min[j] + ctl.q_max[j]) else -obs.dq[j]
        if out > 0.0 and outward > _MOVES_OUT_RAD_S and is_on(ctl, JOINT_LIMIT):
            return JOINT_LIMIT
        if abs(obs.dq[j]) > ctl.dq_share * speed_limit(ctl, j, obs.q[j], obs.dq[j]) and is_on(ctl, JOINT_SPEED):
            return JOINT_SPEED
    return NO_CAUSE
