"""How well the mean of a sensor's reading is known, where neighbouring samples are alike.

A sensor's own low-pass, and samples that are logged more than once, make neighbours alike, so that a mean of n samples
is known less well than sigma / sqrt(n). Means of stretches that are longer than that are independent: how those scatter
tells. What creeps makes them scatter more, as it should.
"""

import numpy as np
from jaxtyping import Float

_BLOCK_S = 0.05  # Much longer than the low-pass of any sensor remembers.
# Nobody knows the mean of a sensor's reading any better [N, N.m].
FLOOR = np.repeat([1e-3, 5e-5], 3)


def blocks_of(rows: Float[np.ndarray, "n d"], period_s: float) -> Float[np.ndarray, "m d"]:
    """Means of stretches of 50 ms, or of two halves where there is less. Shape (m, d).

    Args:
        rows: At rest, two at least. Shape (n, d).
        period_s: Between two of them [s].
    """
    size = max(1, min(round(_BLOCK_S / period_s), len(rows) // 2))
    whole = len(rows) // size * size
    return rows[:whole].reshape(-1, size, rows.shape[1]).mean(axis=1)


def standard_error(rows: Float[np.ndarray, "n d"], period_s: float) -> Float[np.ndarray, " d"]:
    """Standard deviation of the mean of some samples at rest. Shape (d,); arguments as for `blocks_of`."""
    blocks = blocks_of(rows, period_s)
    return np.maximum(blocks.std(axis=0, ddof=1) / np.sqrt(len(blocks)), FLOOR[: rows.shape[1]])
