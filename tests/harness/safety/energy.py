"""Energy: what the controller may put into the true arm, whatever its own ledger says."""

import itertools
from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from safety.findings import Finding, worst_of
from safety.trace import Trace
from wrenchflow.control.config import ControlConfig
from wrenchflow.control.safeguards import LATCHED, SOFT_STOP, TORQUE, TORQUE_RATE

TICK_S = 0.001


def spans(trace: Trace) -> Iterator[tuple[int, int]]:
    """The ticks from one start of the controller to before the next: a start fills the tank anew."""
    starts = [*np.flatnonzero(trace.before["tick"] == 0), len(trace)]
    yield from itertools.pairwise(starts)


def check_tank(trace: Trace) -> list[Finding]:
    """I1: the tank is never overdrawn."""
    return [worst_of("I1 tank", -trace.after["tank"], 0.0)]


def check_work(trace: Trace, config: ControlConfig, slack_j: float, slack_w: float) -> list[Finding]:
    """I2: what the torque did to the true arm is paid for by what there was, from any tick to any later one.

    Work between two ticks may be what the spring and the tank held at the first, and what was filled in since. That is
    more than the invariant says, which is about the first tick only. What a hand does is not the controller's work.

    Args:
        trace: One run.
        config: Limits and gains.
        slack_j: What noise of the measured joints may hide [J].
        slack_w: The same, each second [W].
    """
    since_start, since_any = np.full(len(trace), -np.inf), np.full(len(trace), -np.inf)
    for start, stop in spans(trace):
        after, work = trace.after[start:stop], trace.work[start:stop]
        t = np.arange(1, stop - start + 1) * TICK_S
        done = np.cumsum(work) - (config.tank_fill_w + slack_w) * t
        since_start[start:stop] = done - config.tank_start_j
        # `after[k]` holds what there was when the torque of tick k began to act; latched, it holds nothing of use.
        before = done - work + (config.tank_fill_w + slack_w) * TICK_S
        held = np.where(after["mode"] == LATCHED, np.nan_to_num(after["tank"]), after["tank"]) + after["spring"]
        most = np.maximum.accumulate(done[::-1])[::-1]
        since_any[start:stop] = most - before - held
    return [
        worst_of("I2 work since the start [J over]", since_start, slack_j),
        worst_of("I2 work since any tick [J over]", since_any, slack_j),
    ]


def spring_energy(trace: Trace) -> np.ndarray:
    """Potential of the spring at the true pose, after the tick's changes [J]. Shape (n,)."""
    after, truth = trace.after, trace.truth
    e = after["x_d"] - truth["x"]
    R_d = np.where(np.isfinite(after["R_d"]), after["R_d"], np.eye(3))
    R = np.einsum("nij,nkj->nik", R_d, truth["R"])
    turn = Rotation.from_matrix(R).as_rotvec()
    linear = np.einsum("ni,nij,nj->n", e, after["K_lin"], e)
    return 0.5 * after["gain"] * (linear + np.einsum("ni,nij,nj->n", turn, after["K_rot"], turn))


def check_passive(trace: Trace) -> list[Finding]:
    """I6: while reference and stiffness stay and nothing is touched, kinetic and spring energy together never rise.

    For a perfect measurement, and without a nullspace spring, whose potential is not counted. A torque that is held for
    a millisecond may give back a millionth of what there is.
    """
    after, finite = trace.after, np.isfinite(trace.after["R_d"]).all((1, 2))
    same = np.zeros(len(trace), bool)
    same[1:] = trace.is_free[1:] & trace.is_free[:-1] & finite[1:] & finite[:-1] & ~trace.truth["tampered"][1:]
    same &= (after["mode"] < SOFT_STOP) & (after["mode"] >= 0)
    for name in ("x_d", "R_d", "K_lin", "K_rot", "gain", "damping_ratio"):
        moved = np.abs(np.diff(after[name].reshape(len(trace), -1), axis=0)).max(1)
        same[1:] &= moved <= 1e-14
    # What acts from one tick to the next is the torque of the first.
    fed, limited = (after["wrench_command"] != 0.0).any(1), (after["acting"] & (1 << TORQUE | 1 << TORQUE_RATE)) != 0
    same[1:] &= ~(fed | limited)[:-1]
    energy = np.where(finite, trace.kinetic + spring_energy(trace), np.nan)
    rise, lowest = np.full(len(trace), -np.inf), np.inf
    for k in range(1, len(trace)):
        if not same[k]:
            lowest = np.inf
            continue
        lowest = min(lowest, energy[k - 1])
        rise[k] = (energy[k] - lowest) / (lowest + 1e-6)
    return [worst_of("I6 energy rise [share]", rise, 1e-6, same)]
