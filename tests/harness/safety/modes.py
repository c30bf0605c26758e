"""I5: who falls silent is not followed for long, and the arm comes to rest."""

import numpy as np
from safety.findings import Finding, worst_of
from safety.trace import Trace

from wrenchflow.control.safeguards import RUN

SETTLED_TICKS = 3000
SETTLED_SHARE = 0.01


def check_silence(trace: Trace) -> list[Finding]:
    """I5: the arm runs no longer than patience and one tick after the last request; then it slows down.

    When somebody asked is known from the log: the controller's own count of silent ticks is not looked at.
    """
    before, after = trace.before, trace.after
    ticks = np.arange(len(trace))
    asked = np.maximum.accumulate(np.where((before["is_fresh"] != 0) & trace.truth["acted"], ticks, -1))
    over = np.where(asked >= 0, ticks - asked - before["patience_ticks"], -1).astype(float)
    expires = (before["patience_ticks"] > 0) & (after["mode"] == RUN)
    return [worst_of("I5 runs on in silence [ticks over]", over, 0.0, expires), *check_rest(trace)]


def check_rest(trace: Trace) -> list[Finding]:
    """I5: three seconds after the last tick of RUN little is left of the energy of motion, if nobody pushes."""
    ran = np.flatnonzero(trace.after["mode"] == RUN)
    share = np.full(len(trace), -np.inf)
    if len(ran) and ran[-1] + SETTLED_TICKS < len(trace):
        start = ran[-1] + 1
        if trace.is_free[start:].all():
            most = trace.kinetic[start] + trace.after["spring"][start] + 1e-3
            share[start + SETTLED_TICKS :] = trace.kinetic[start + SETTLED_TICKS :] / most
    return [worst_of("I5 motion left after silence [share]", share, SETTLED_SHARE)]
