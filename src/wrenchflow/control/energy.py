"""The energy ledger: what the spring holds, what each part of the torque did, and who pays for it.

The tank E is what may still be put into the spring. Everything is measured, nothing is linearised: with S the spring's
potential at the measured pose, and dq the measured displacement of the joints since the last command,

    E -= tau_spring . dq - (S_before - S_after)    what the spring did beyond what it lost: hold for a tick, curvature
    E -= max(tau_part . dq, 0)                     feed-forward, nullspace and Coriolis, what the limits changed
    E += 0.9 damped work                           and whatever damping put in is paid in full
    E += P_fill T                                  while plans come in time

so the work done on the arm never exceeds S0 + E0 + P_fill t as long as E >= 0. What would overdraw the tank is taken
from the spring. The observer keeps an account of its own, on the final torque alone: whatever the parts were called.

Source of the tank: Ferraguti, Secchi, Fantuzzi, *A Tank-Based Approach to Impedance Control with Variable Stiffness*
(2013); the exact differences are ours.
"""

import math

from wrenchflow.compiled import kernel
from wrenchflow.control.gate import is_on, note
from wrenchflow.control.records import JOINTS
from wrenchflow.control.safeguards import RUN, TANK_DEBT, TANK_STIFFNESS
from wrenchflow.so3 import exp_into, log_into, multiply_into, multiply_transposed_into

_ROUNDING_J = 1e-12


@kernel
def error_into(ctl, x, R):
    """Set e = [x_d - x ; log(R_d R^T)], world-aligned, into `ctl.e`."""
    multiply_transposed_into(ctl.R_d, R, ctl.matrices[0])
    log_into(ctl.matrices[0], ctl.vector)
    for i in range(3):
        ctl.e[i], ctl.e[3 + i] = ctl.x_d[i] - x[i], ctl.vector[i]


@kernel
def potential(e, K_lin, K_rot):
    """Potential of a spring, 1/2 e^T K e [J]."""
    s = 0.0
    for i in range(3):
        for j in range(3):
            s += e[i] * K_lin[i, j] * e[j] + e[3 + i] * K_rot[i, j] * e[3 + j]
    return 0.5 * s


@kernel
def available(ctl):
    """What voluntary changes may still take from the tank [J]."""
    return max(ctl.tank - ctl.tank_reserve, 0.0)


@kernel
def set_spring(ctl, spring):
    """The spring's potential changes on purpose: the tank pays, or gets it back."""
    left = ctl.tank - (spring - ctl.spring)
    # What is affordable to the last bit may round to a little less than nothing.
    ctl.tank = 0.0 if -_ROUNDING_J < left < 0.0 else min(left, ctl.tank_max)
    ctl.spring = spring


@kernel
def account(obs, ctl):
    """Book what happened since the last command, by the measured displacement; leaves `ctl.e` at the present pose."""
    spring, damping, fed, posed, total, exerted, kinetic = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(JOINTS):
        dq = obs.q[j] - ctl.q_last[j]
        spring += ctl.tau_spring[j] * dq
        damping += ctl.tau_damping[j] * dq
        fed += ctl.tau_fed[j] * dq
        posed += ctl.tau_posed[j] * dq
        total += ctl.tau[j] * dq
        if math.isfinite(obs.tau_external[j]):  # No torque rests on it, so it need not be there.
            exerted += obs.tau_external[j] * dq
        for k in range(JOINTS):
            kinetic += 0.5 * obs.dq[j] * obs.M[j, k] * obs.dq[k]
    saturated = total - spring - damping - fed - posed
    ctl.damped -= damping
    ctl.fed += fed
    ctl.posed += posed
    ctl.saturated += saturated
    ctl.exerted += exerted
    ctl.kinetic = kinetic
    error_into(ctl, obs.x, obs.R)
    after = ctl.gain * potential(ctl.e, ctl.K_lin, ctl.K_rot)
    cost = spring - (ctl.spring - after) + max(fed, 0.0) + max(posed, 0.0) + max(saturated, 0.0)
    cost += damping if damping > 0.0 else ctl.refill_share * damping
    fill = ctl.tank_fill if ctl.mode == RUN or ctl.is_waiting else 0.0
    ctl.filled += fill
    ctl.spring = after
    ctl.tank = min(ctl.tank - cost + fill, ctl.tank_max)
    if ctl.tank < 0.0 and is_on(ctl, TANK_DEBT):
        _relax(obs, ctl)
    # What is left of what the tank and the spring hold together: more than that, no torque may do.
    ctl.budget = min(ctl.budget - total + fill, ctl.tank_max + ctl.spring)


@kernel
def _relax(obs, ctl):
    """Take what the tank owes from the spring: its reference comes nearer. The observer sees what even that left."""
    note(ctl, TANK_DEBT)
    owed = -ctl.tank
    share = math.sqrt(1.0 - owed / ctl.spring) if ctl.spring > owed else 0.0
    ctl.tank = 0.0
    ctl.spring *= share * share
    for i in range(6):
        ctl.e[i] *= share
    exp_into(ctl.e[3], ctl.e[4], ctl.e[5], ctl.matrices[0])
    multiply_into(ctl.matrices[0], obs.R, ctl.R_d)
    for i in range(3):
        ctl.x_d[i] = obs.x[i] + ctl.e[i]


@kernel
def raise_gain(ctl):
    """Let the gain rise after the start as far as its ramp and the tank allow; `ctl.e` is that of the present pose."""
    wanted = min(1.0, ctl.tick / ctl.ramp_ticks) if ctl.ramp_ticks > 0 else 1.0
    if wanted <= ctl.gain:
        return
    unit = potential(ctl.e, ctl.K_lin, ctl.K_rot)
    if (wanted - ctl.gain) * unit > available(ctl) and is_on(ctl, TANK_STIFFNESS):
        wanted = ctl.gain + available(ctl) / unit
        note(ctl, TANK_STIFFNESS)
    ctl.gain = wanted
    set_spring(ctl, wanted * unit)
