"""The energy ledger against the work that was really done, part by part."""

from collections.abc import Iterator

import numpy as np

from safety.energy import TICK_S, spans
from safety.findings import Finding
from safety.trace import Trace
from wrenchflow.control.config import ControlConfig
from wrenchflow.control.safeguards import RUN

SIGMAS = 5.0  # Of what noise may hide; of two million ticks' runs not one is then expected beyond.


def _really_done(trace: Trace, start: int, stop: int, noise_rad: float) -> dict[str, tuple[float, float]]:
    """Work from tick `start` to before `stop` on the true arm, by the names of the ledger, and what noise may hide [J].

    Noise n of the measured joints adds tau_k (n_k+1 - n_k) at each tick; summed up, that is n times the changes of the
    torque, whose standard deviation is known.
    """
    after, truth = trace.after[start:stop], trace.truth[start:stop]
    moved = truth["q_after"] - truth["q"]
    work = {name: float((after[f"tau_{name}"] * moved).sum()) for name in ("spring", "damping", "fed", "posed")}
    total = float((after["tau"] * moved).sum())
    parts = sum(after[f"tau_{name}"] for name in work)
    torque = {
        "damped": after["tau_damping"],
        "fed": after["tau_fed"],
        "posed": after["tau_posed"],
        "saturated": after["tau"] - parts,
        "exerted": truth["constraint"],
    }
    done = {
        "damped": -work["damping"],
        "fed": work["fed"],
        "posed": work["posed"],
        "saturated": total - sum(work.values()),
        "exerted": -float((truth["constraint"] * moved).sum()),
    }
    changes = {name: np.diff(each, axis=0, prepend=0.0, append=0.0) for name, each in torque.items()}
    return {name: (done[name], SIGMAS * noise_rad * float(np.sqrt((changes[name] ** 2).sum()))) for name in done}


def check_ledger(
    trace: Trace, config: ControlConfig, slack_j: float, slack_w: float, noise_rad: float
) -> list[Finding]:
    """The sums that the controller keeps are those of the true arm, within the noise of what it measures.

    Where what it sees was tampered with, it cannot know better.
    """
    found = []
    for start, stop in _honest(trace):
        seconds = (stop - start) * TICK_S
        last = trace.after[stop - 1]
        # What a tick's torque does is booked at the next tick; sums go on over a reset.
        first = trace.before[start]
        for name, (value, hidden_j) in _really_done(trace, start, stop - 1, noise_rad).items():
            error = abs(float(last[name] - first[name]) - value)
            found.append(Finding(f"ledger: {name} [J]", error, slack_j + slack_w * seconds + hidden_j, stop - 1))
        before = trace.before[start:stop]
        fills = (before["tick"] > 0) & ((before["mode"] == RUN) | (before["is_waiting"] != 0))
        filled = config.tank_fill_w * TICK_S * float(fills.sum())
        error = abs(float(last["filled"] - first["filled"]) - filled)
        found.append(Finding("ledger: filled [J]", error, 1e-9, stop - 1))
    return found


def _honest(trace: Trace) -> Iterator[tuple[int, int]]:
    for start, stop in spans(trace):
        if stop - start > 2 and not trace.truth["tampered"][start:stop].any():
            yield start, stop
