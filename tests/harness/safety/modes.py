"""I5: who falls silent is not followed for long, and the arm comes to rest."""

import numpy as np

from safety.findings import Finding, worst_of
from safety.trace import Trace
from wrenchflow.control.safeguards import RUN

SETTLED_TICKS = 3000
SETTLED_SHARE = 0.01


def check_silence(trace: Trace) -> list[Finding]:
    """I5: the arm runs no longer than patience and one tick after the last sound request; then it slows down.

    Patience is that of the last sound request: what is refused must not prolong it.
    """
    before, after = trace.before, trace.after
    ticks = np.arange(len(trace))
    # A plan that was accepted is sound, whatever segment came beside it.
    sound = (before["is_fresh"] != 0) | ((before["is_asked"] != 0) & (after["is_refused"] == 0))
    asked = np.maximum.accumulate(np.where(sound, ticks, -1))
    patience = after["patience_ticks"][np.maximum(asked, 0)]
    expires = (asked >= 0) & (patience > 0) & (after["mode"] == RUN)
    over = (ticks - asked - patience).astype(float)
    return [worst_of("I5 runs on in silence [ticks over]", over, 0.0, expires), *check_rest(trace)]


def check_rest(trace: Trace) -> list[Finding]:
    """I5: three seconds after the last tick of RUN little is left of the energy of motion, if nobody pushes."""
    ran = np.flatnonzero(trace.after["mode"] == RUN)
    share = np.full(len(trace), -np.inf)
    if len(ran) and ran[-1] + SETTLED_TICKS < len(trace):
        start = ran[-1] + 1
        if not trace.is_pushed[start:].any():
            most = trace.kinetic[start] + trace.after["spring"][start] + 1e-3
            share[start + SETTLED_TICKS :] = trace.kinetic[start + SETTLED_TICKS :] / most
    return [worst_of("I5 motion left after silence [share]", share, SETTLED_SHARE)]
