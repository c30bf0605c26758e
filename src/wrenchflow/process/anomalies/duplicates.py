"""Columns that say the same: a cable that is plugged in twice, or an index that is off by one."""

from collections.abc import Iterator
from itertools import combinations

import numpy as np

from wrenchflow.process.anomalies.look import MIN_FREE, Look
from wrenchflow.process.finding import Finding

KIND = "duplicate-column"
# Of the correlation of what is left of two columns after a running median. Noise of two channels is their own; but a
# slow log leaves the push itself in it, and a force with its lever arm comes to 0.98 (in a recording of screw driving).
LIMIT = 0.99


def find_duplicates(look: Look) -> Iterator[Finding]:
    """Find pairs of columns whose noise is the same, whatever the factor and the sign between them."""
    rows = look.rough[look.free] if look.free.sum() >= MIN_FREE else look.rough
    if len(rows) < MIN_FREE:
        return
    moving = [i for i in range(rows.shape[1]) if rows[:, i].std() > 0.0]
    for i, j in combinations(moving, 2):
        correlation = float(np.corrcoef(rows[:, i], rows[:, j])[0, 1])
        if abs(correlation) > LIMIT:
            yield Finding(
                kind=KIND,
                severity="defect",
                start_ns=int(look.t[0]),
                stop_ns=look.stop_ns(len(look.t) - 1),
                columns=(look.columns[i], look.columns[j]),
                evidence=f"the noise of {look.columns[i]} and {look.columns[j]} is the same (correlation "
                f"{correlation:+.3f}, expected within {LIMIT:g} of 0)",
                samples=len(look.t),
            )
