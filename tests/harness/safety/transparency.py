"""I8: a safety layer that does not act changes nothing, to the last bit."""

import numpy as np

from safety.findings import Finding, worst_of
from safety.trace import Trace
from wrenchflow.control import impedance as law
from wrenchflow.control.safeguards import SAFEGUARDS
from wrenchflow.control.schedule import make_schedule

NOTHING_LEFT = (1 << len(SAFEGUARDS)) - 1


def check_transparent(trace: Trace) -> list[Finding]:
    """I8: where no safeguard acted, the torque is that of the law alone, given the same state, request and observation.

    The law alone is the controller with every safeguard left out. A safeguard that says that it acted may have changed
    something; one that does not say so must not have.
    """
    silent = np.flatnonzero(trace.after["acting"] == 0)
    obs, req, alone = trace.obs[silent].copy(), trace.req[silent].copy(), trace.before[silent].copy()
    alone["without"] = NOTHING_LEFT
    _ask_as_planned(req, alone, trace.after[silent])
    schedule = make_schedule((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for k in range(len(silent)):
        law.tick_each(obs[k : k + 1], req[k : k + 1], schedule, alone[k : k + 1])
    bits = [np.ascontiguousarray(each["tau"]).view(np.int64) for each in (alone, trace.after[silent])]
    differs = np.full(len(trace), -np.inf)
    differs[silent] = (bits[0] != bits[1]).any(1)
    return [worst_of("I8 torque differs where nothing acted", differs, 0.0, trace.after["acting"] == 0)]


def _ask_as_planned(req: np.ndarray, alone: np.ndarray, after: np.ndarray) -> None:
    """Ask in a segment of one tick for what a plan asked for at that tick, to the last bit."""
    planned = after["follows_plan"] != 0
    alone["follows_plan"], alone["segment_tick"][planned] = 0, 0
    req["ticks"][planned], req["turn"][planned], req["x_offset"][planned] = 1, 0.0, 0.0
    for name, target in (
        ("x_start", "x_target"),
        ("x_stop", "x_target"),
        ("R_start", "R_target"),
        ("K_lin", "K_lin_target"),
        ("K_rot", "K_rot_target"),
        ("damping_ratio", "damping_ratio_target"),
        ("wrench", "wrench_target"),
    ):
        req[name][planned] = after[target][planned]
