"""I8: a safety layer that does not act changes nothing, to the last bit."""

import numpy as np
from safety.findings import Finding, worst_of
from safety.trace import Trace

from wrenchflow.control import impedance as law
from wrenchflow.control.safeguards import SAFEGUARDS

NOTHING_LEFT = (1 << len(SAFEGUARDS)) - 1


def check_transparent(trace: Trace) -> list[Finding]:
    """I8: where no safeguard acted, the torque is that of the law alone, given the same state, request and observation.

    The law alone is the controller with every safeguard left out. A safeguard that says that it acted may have changed
    something; one that does not say so must not have.
    """
    silent = trace.after["acting"] == 0
    alone = trace.before[silent].copy()
    alone["without"] = NOTHING_LEFT
    law.tick_each(trace.obs[silent].copy(), trace.req[silent].copy(), alone)
    differs = np.full(len(trace), -np.inf)
    same = np.ascontiguousarray(alone["tau"]).view(np.int64) == np.ascontiguousarray(trace.after["tau"][silent]).view(
        np.int64
    )
    differs[silent] = (~same.reshape(-1, 7)).any(1)
    return [worst_of("I8 torque differs where nothing acted", differs, 0.0, silent)]
