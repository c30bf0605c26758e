"""How stiff the arm may get, and how fast: a range, a slew limit, and what the tank can pay.

Slew, after Kronander and Billard: with B = K + a D - a^2 M, the energy V = 1/2 (x' + a x)^T M (x' + a x) + 1/2 x^T B x
does not rise as long as a M <= D and K' + a D' <= 2 a K. With D = 2 zeta sqrt(K m) that is, for one axis,

    K' <= 2 a K / (1 + a zeta sqrt(m / K)),        a = 2 zeta_min sqrt(K_min / m)

with m the largest task inertia and K_min, zeta_min the smallest values allowed. For a matrix the step dK must keep
dK <= r K with the relative rate r of the softest axis. While the damping ratio rises too, each takes half. It reckons
with a constant inertia, so it is a limit; the tank is the guarantee.

Source: Kronander, Billard, *Stability Considerations for Variable Impedance Control* (2016).
"""

import math

import numpy as np

from wrenchflow.compiled import kernel
from wrenchflow.control.damping import cholesky, eigen_symmetric, solve_lower
from wrenchflow.control.energy import available, potential, set_spring
from wrenchflow.control.gate import copy_into, is_on, note
from wrenchflow.control.safeguards import (
    DAMPING_RANGE,
    DAMPING_SLEW,
    STIFFNESS_RANGE,
    STIFFNESS_SLEW,
    TANK_STIFFNESS,
)

TICK_S = 0.001


@kernel
def govern_stiffness(ctl):
    """Bring stiffness and damping ratio one tick nearer to what is asked; `ctl.e` is that of the present pose."""
    wanted_lin, wanted_rot = ctl.matrices[1], ctl.matrices[2]
    _into_range(ctl, ctl.K_lin_target, ctl.K_lin_min, ctl.K_lin_max, wanted_lin)
    _into_range(ctl, ctl.K_rot_target, ctl.K_rot_min, ctl.K_rot_max, wanted_rot)
    rises = _govern_damping_ratio(ctl)
    moves_lin, moves_rot = not _is_same(wanted_lin, ctl.K_lin), not _is_same(wanted_rot, ctl.K_rot)
    if not (moves_lin or moves_rot):
        return
    share = 1.0
    if moves_lin:
        a = 2.0 * ctl.damping_ratio_min * math.sqrt(ctl.K_lin_min / ctl.inertia_lin_max)
        share = _slew(ctl, ctl.K_lin, wanted_lin, a, ctl.inertia_lin_max, ctl.K_lin_fall_max, rises)
    if moves_rot:
        a = 2.0 * ctl.damping_ratio_min * math.sqrt(ctl.K_rot_min / ctl.inertia_rot_max)
        share = min(share, _slew(ctl, ctl.K_rot, wanted_rot, a, ctl.inertia_rot_max, ctl.K_rot_fall_max, rises))
    if share < 1.0:
        note(ctl, STIFFNESS_SLEW)
    _step(ctl.K_lin, wanted_lin, share)
    _step(ctl.K_rot, wanted_rot, share)
    spring = ctl.gain * potential(ctl.e, wanted_lin, wanted_rot)
    cost = spring - ctl.spring
    if cost > available(ctl) and is_on(ctl, TANK_STIFFNESS):
        # The potential is linear in the stiffness, so the share that can be paid is exact.
        note(ctl, TANK_STIFFNESS)
        paid = available(ctl) / cost
        _step(ctl.K_lin, wanted_lin, paid)
        _step(ctl.K_rot, wanted_rot, paid)
        spring = ctl.gain * potential(ctl.e, wanted_lin, wanted_rot)
    copy_into(wanted_lin, ctl.K_lin)
    copy_into(wanted_rot, ctl.K_rot)
    set_spring(ctl, spring)


@kernel
def _step(K, wanted, share):
    """Set wanted = K + share (wanted - K); a whole step is left as it is, to the last bit."""
    if share == 1.0:
        return
    for i in range(3):
        for j in range(3):
            wanted[i, j] = K[i, j] + share * (wanted[i, j] - K[i, j])


@kernel
def _is_same(A, B):
    for i in range(3):
        for j in range(3):
            if A[i, j] != B[i, j]:
                return False
    return True


@kernel
def clamp_stiffness(K, low, high, out):
    """Raise and lower the principal stiffnesses of `K` into a range, along its own axes, into `out`.

    Returns:
        Whether anything was changed.
    """
    if K[0, 1] == 0.0 and K[0, 2] == 0.0 and K[1, 2] == 0.0:
        changed = False
        for i in range(3):
            for j in range(3):
                out[i, j] = 0.0
            out[i, i] = min(max(K[i, i], low), high)
            changed = changed or out[i, i] != K[i, i]
        return changed
    # Small scratch matrices are the stack's, and only for stiffnesses that are not along the base axes.
    A, U = np.empty((3, 3)), np.empty((3, 3))
    copy_into(K, A)
    eigen_symmetric(A, U)
    changed = False
    for i in range(3):
        changed = changed or A[i, i] < low or A[i, i] > high
    for i in range(3):
        for j in range(i + 1):
            s = 0.5 * (K[i, j] + K[j, i])
            if changed:
                s = 0.0
                for k in range(3):
                    s += U[i, k] * min(max(A[k, k], low), high) * U[j, k]
            out[i, j] = s
            out[j, i] = s
    return changed


@kernel
def _into_range(ctl, K, low, high, out):
    if not is_on(ctl, STIFFNESS_RANGE):
        copy_into(K, out)
    elif clamp_stiffness(K, low, high, out):
        note(ctl, STIFFNESS_RANGE)


@kernel
def _slew(ctl, K, wanted, a, inertia, fall_max, damping_rises):
    """The largest share, up to 1, of the step from K to `wanted` that one tick may make."""
    if not is_on(ctl, STIFFNESS_SLEW):
        return 1.0
    softest, rise, fall = _extremes(K, wanted)
    rate = 2.0 * a / (1.0 + a * ctl.damping_ratio * math.sqrt(inertia / softest)) * TICK_S
    if damping_rises:
        rate *= 0.5
    share = 1.0
    if rise > rate:
        share = rate / rise
    if fall > fall_max:
        share = min(share, fall_max / fall)
    return share


@kernel
def _extremes(K, wanted):
    """The smallest stiffness of K, the largest relative rise to `wanted`, and the largest fall."""
    if K[0, 1] == K[0, 2] == K[1, 2] == wanted[0, 1] == wanted[0, 2] == wanted[1, 2] == 0.0:
        softest, rise, fall = K[0, 0], 0.0, 0.0
        for i in range(3):
            softest = min(softest, K[i, i])
            rise = max(rise, (wanted[i, i] - K[i, i]) / K[i, i])
            fall = max(fall, K[i, i] - wanted[i, i])
        return softest, rise, fall
    A, U, L, step = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    copy_into(K, A)
    eigen_symmetric(A, U)
    softest = min(A[0, 0], min(A[1, 1], A[2, 2]))
    for i in range(3):
        for j in range(3):
            A[i, j] = step[i, j] = wanted[i, j] - K[i, j]
    eigen_symmetric(A, U)
    fall = max(0.0, -min(A[0, 0], min(A[1, 1], A[2, 2])))
    # The largest eigenvalue of L^-1 dK L^-T, where K = L L^T.
    cholesky(K, L)
    solve_lower(L, step)
    for i in range(3):
        for j in range(3):
            A[i, j] = step[j, i]
    solve_lower(L, A)
    for i in range(3):
        for j in range(i):
            A[i, j] = A[j, i] = 0.5 * (A[i, j] + A[j, i])
    eigen_symmetric(A, U)
    return softest, max(0.0, max(A[0, 0], max(A[1, 1], A[2, 2]))), fall


@kernel
def _govern_damping_ratio(ctl):
    """Bring the damping ratio nearer to what is asked; it may fall at once. Returns whether it rises."""
    wanted = ctl.damping_ratio_target
    if is_on(ctl, DAMPING_RANGE):
        wanted = min(max(wanted, ctl.damping_ratio_min), ctl.damping_ratio_max)
        if wanted != ctl.damping_ratio_target:
            note(ctl, DAMPING_RANGE)
    if wanted <= ctl.damping_ratio or not is_on(ctl, DAMPING_SLEW):
        ctl.damping_ratio = wanted
        return False
    # a D' <= a K, half of what K' + a D' <= 2 a K allows.
    softest_lin, _, _ = _extremes(ctl.K_lin, ctl.K_lin)
    softest_rot, _, _ = _extremes(ctl.K_rot, ctl.K_rot)
    rate = 0.5 * math.sqrt(min(softest_lin / ctl.inertia_lin_max, softest_rot / ctl.inertia_rot_max))
    if wanted - ctl.damping_ratio > rate * TICK_S:
        wanted = ctl.damping_ratio + rate * TICK_S
        note(ctl, DAMPING_SLEW)
    ctl.damping_ratio = wanted
    return True
