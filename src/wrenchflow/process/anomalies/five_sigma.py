"""The rule of five standard deviations, under its own name: it tells contact, and no anomaly.

Flagging each filtered sample that is further than five standard deviations of free motion from it is what many
pipelines call anomaly detection. On a contact task it flags exactly the samples that matter, so here it is no detector
of faults: it is kept for whoever wants to compare, and a test shows what it does.
"""

import numpy as np
from jaxtyping import Bool

from wrenchflow.episode import Stream

SIGMAS = 5.0


def five_sigma(labels: Stream, free: Bool[np.ndarray, " n"]) -> Bool[np.ndarray, "n d"]:
    """Whether each filtered sample lies further than five standard deviations of free motion from its mean.

    Args:
        labels: `wrench_zero_phase`.
        free: Whether each sample lies in free motion. Shape (n,).

    Returns:
        A flag a sample and column, shape (n, d); all False where there is no free motion.
    """
    rest = labels.data[free]
    if len(rest) < 2:
        return np.zeros(labels.data.shape, bool)
    return np.abs(labels.data - rest.mean(axis=0)) > SIGMAS * rest.std(axis=0, ddof=1)
