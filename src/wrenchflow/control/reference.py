"""Where the reference goes: into the workspace, on a leash from the tool, at a speed, and as far as the tank pays.

First it is retracted to where its spring pulls with the largest force allowed, without any limit, for that costs no
energy. Then it makes a voluntary step towards the target, which is limited. Both ends of that step lie within the
leash, so the reference does at every tick. The leash is a box, so that a push along one axis does not take from the
others; `cap_norm` bounds the whole force.
"""

import math

from wrenchflow.compiled import kernel
from wrenchflow.control.energy import available, error_into, potential, set_spring
from wrenchflow.control.gate import copy_into, is_on, note
from wrenchflow.control.safeguards import (
    CONTACT_ZONE,
    LEASH,
    LEASH_ROTATION,
    SPEED,
    TANK_REFERENCE,
    TURN,
    WORKSPACE,
)
from wrenchflow.so3 import exp_into, log_into, multiply_into, multiply_transposed_into

_HALVINGS = 40  # Of the share of a step that the tank can pay for: to the last bits of a double.


@kernel
def govern_reference(obs, ctl, moves):
    """Retract the reference, and where it `moves`, step it towards the target; leaves `ctl.e` at its new place."""
    _retract(obs, ctl)
    if moves:
        _step_position(obs, ctl)
        _step_rotation(obs, ctl)
        _pay_step(obs, ctl)


@kernel
def speed_max(ctl, x):
    """The speed that the reference may have when the tool is at `x`, as a step a tick [m]."""
    return min(ctl.x_step_max, _zone_speed_max(ctl, x))


@kernel
def _zone_speed_max(ctl, x):
    """The same for the sake of the zone where contact is expected: small in it, more with the distance from there."""
    square = 0.0
    for i in range(3):
        beside = max(max(ctl.zone_min[i] - x[i], x[i] - ctl.zone_max[i]), 0.0)
        square += beside * beside
    return ctl.zone_step_max + ctl.zone_slowing * math.sqrt(square)


@kernel
def _leash_m(ctl, i):
    row = abs(ctl.K_lin[i, 0]) + abs(ctl.K_lin[i, 1]) + abs(ctl.K_lin[i, 2])
    return ctl.force_max / row if row > 0.0 else 0.0


@kernel
def _leash_rad(ctl):
    stiffest = 0.0
    for i in range(3):
        stiffest = max(stiffest, abs(ctl.K_rot[i, 0]) + abs(ctl.K_rot[i, 1]) + abs(ctl.K_rot[i, 2]))
    return ctl.moment_max / stiffest if stiffest > 0.0 else 0.0


@kernel
def _retract(obs, ctl):
    held, smallest, from_tool = True, 1.0, ctl.step
    if is_on(ctl, LEASH):
        for i in range(3):
            from_tool[i] = ctl.e[i]
            leash = _leash_m(ctl, i)
            low, high = obs.x[i] - leash, obs.x[i] + leash
            if ctl.x_d[i] < low or ctl.x_d[i] > high:
                held = False
                smallest = min(smallest, leash / abs(from_tool[i]))
                ctl.x_d[i] = min(max(ctl.x_d[i], low), high)
    if not held:
        note(ctl, LEASH)
    if is_on(ctl, LEASH_ROTATION) and pull_within(ctl.R_d, obs.R, _leash_rad(ctl), ctl.matrices, ctl.vector):
        note(ctl, LEASH_ROTATION)
        held = False
    if held:
        return
    before = ctl.spring
    error_into(ctl, obs.x, obs.R)
    after = ctl.gain * potential(ctl.e, ctl.K_lin, ctl.K_rot)
    if after > before:
        # Where the axes of the stiffness are not the base's, a shorter arm can be the stiffer one: then all of it is
        # shortened, which always relaxes the spring.
        for i in range(3):
            ctl.x_d[i] = obs.x[i] + smallest * from_tool[i]
        error_into(ctl, obs.x, obs.R)
        after = min(ctl.gain * potential(ctl.e, ctl.K_lin, ctl.K_rot), before)
    set_spring(ctl, after)


@kernel
def _step_position(obs, ctl):
    """The voluntary step of the position, into `ctl.step`; where nothing limits it, it ends exactly at the target."""
    wanted, distance = ctl.sample, 0.0
    for i in range(3):
        target = ctl.x_target[i] + ctl.x_offset[i]
        if is_on(ctl, WORKSPACE):
            inside = min(max(target, ctl.workspace_min[i]), ctl.workspace_max[i])
            if inside != target:
                note(ctl, WORKSPACE)
            target = inside
        if is_on(ctl, LEASH):
            leash = _leash_m(ctl, i)
            near = min(max(target, obs.x[i] - leash), obs.x[i] + leash)
            if near != target:
                note(ctl, LEASH)
            target = near
        wanted[i] = target
        distance += (target - ctl.x_d[i]) ** 2
    distance = math.sqrt(distance)
    step_max = distance
    if is_on(ctl, SPEED) and distance > ctl.x_step_max:
        note(ctl, SPEED)
        step_max = ctl.x_step_max
    if is_on(ctl, CONTACT_ZONE):
        allowed = min(_zone_speed_max(ctl, obs.x), _zone_speed_max(ctl, ctl.x_d))
        if step_max > allowed:
            note(ctl, CONTACT_ZONE)
            step_max = allowed
    share = step_max / distance if distance > 0.0 else 1.0
    for i in range(3):
        ctl.step[i] = ctl.x_d[i]
        ctl.x_d[i] = wanted[i] if share == 1.0 else ctl.x_d[i] + share * (wanted[i] - ctl.x_d[i])


@kernel
def _step_rotation(obs, ctl):
    """The voluntary turn: within an angle of the measured orientation, then a limited turn towards the target."""
    wanted, before = ctl.matrices[2], ctl.matrices[3]
    copy_into(ctl.R_d, before)
    copy_into(ctl.R_target, wanted)
    if is_on(ctl, LEASH_ROTATION) and pull_within(wanted, obs.R, _leash_rad(ctl), ctl.matrices, ctl.vector):
        note(ctl, LEASH_ROTATION)
    if is_on(ctl, TURN) and pull_within(wanted, ctl.R_d, ctl.turn_step_max, ctl.matrices, ctl.vector):
        note(ctl, TURN)
    if is_on(ctl, CONTACT_ZONE):
        # A tool that turns about its tip hits too: where it must go slowly, it turns slowly by the same share.
        slowest = min(_zone_speed_max(ctl, obs.x), _zone_speed_max(ctl, ctl.x_d)) / ctl.x_step_max
        if pull_within(wanted, ctl.R_d, slowest * ctl.turn_step_max, ctl.matrices, ctl.vector):
            note(ctl, CONTACT_ZONE)
    _orthonormal_into(wanted, ctl.R_d)


@kernel
def _pay_step(obs, ctl):
    """Let the tank pay for the step, or shorten it to what the tank can pay for."""
    error_into(ctl, obs.x, obs.R)
    spring = ctl.gain * potential(ctl.e, ctl.K_lin, ctl.K_rot)
    if spring - ctl.spring > available(ctl) and is_on(ctl, TANK_REFERENCE):
        note(ctl, TANK_REFERENCE)
        spring = _shorten(obs, ctl)
    set_spring(ctl, spring)


@kernel
def _shorten(obs, ctl):
    """Find, by halving, how much of the step the tank can pay for; returns the spring's potential there."""
    x_from, x_to, R_from, vector = ctl.step, ctl.sample, ctl.matrices[3], ctl.vector
    for i in range(3):
        x_to[i] = ctl.x_d[i]
    multiply_transposed_into(ctl.R_d, R_from, ctl.matrices[0])
    log_into(ctl.matrices[0], vector)
    rx, ry, rz = vector[0], vector[1], vector[2]
    ceiling = ctl.spring + available(ctl)
    low, high = 0.0, 1.0
    for k in range(_HALVINGS + 1):
        # The last look is at a share that is known to be paid for.
        share = low if k == _HALVINGS else 0.5 * (low + high)
        for i in range(3):
            ctl.x_d[i] = x_from[i] + share * (x_to[i] - x_from[i])
        exp_into(share * rx, share * ry, share * rz, ctl.matrices[1])
        multiply_into(ctl.matrices[1], R_from, ctl.matrices[2])
        _orthonormal_into(ctl.matrices[2], ctl.R_d)
        error_into(ctl, obs.x, obs.R)
        spring = ctl.gain * potential(ctl.e, ctl.K_lin, ctl.K_rot)
        if spring <= ceiling:
            low = share
        else:
            high = share
    return spring


@kernel
def pull_within(rotation, centre, angle_max, work, vector):
    """Turn a rotation to within an angle of another; returns whether that changed it."""
    difference, turned = work[0], work[1]
    multiply_transposed_into(rotation, centre, difference)
    # Mostly it is within already; its cosine tells that without the logarithm.
    cosine = (difference[0, 0] + difference[1, 1] + difference[2, 2] - 1.0) / 2.0
    if angle_max >= math.pi or cosine >= math.cos(angle_max):
        return False
    log_into(difference, vector)
    angle = math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
    if angle <= angle_max:  # Rounding: a cosine of a little less than 1 is of no angle at all.
        return False
    share = angle_max / angle
    exp_into(share * vector[0], share * vector[1], share * vector[2], difference)
    multiply_into(difference, centre, turned)
    copy_into(turned, rotation)
    return True


@kernel
def _orthonormal_into(A, out):
    # Products of rotations drift off by an ulp a tick; one Gram-Schmidt a tick keeps the reference a rotation for ever.
    n = math.sqrt(A[0, 0] * A[0, 0] + A[1, 0] * A[1, 0] + A[2, 0] * A[2, 0])
    for i in range(3):
        out[i, 0] = A[i, 0] / n
    dot = out[0, 0] * A[0, 1] + out[1, 0] * A[1, 1] + out[2, 0] * A[2, 1]
    for i in range(3):
        out[i, 1] = A[i, 1] - dot * out[i, 0]
    n = math.sqrt(out[0, 1] * out[0, 1] + out[1, 1] * out[1, 1] + out[2, 1] * out[2, 1])
    for i in range(3):
        out[i, 1] /= n
    out[0, 2] = out[1, 0] * out[2, 1] - out[2, 0] * out[1, 1]
    out[1, 2] = out[2, 0] * out[0, 1] - out[0, 0] * out[2, 1]
    out[2, 2] = out[0, 0] * out[1, 1] - out[1, 0] * out[0, 1]
