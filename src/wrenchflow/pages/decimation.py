"""Fewer points for a line on a screen, with every peak kept."""

import numpy as np
from jaxtyping import Float

# A step in time this many times as long as the usual one is a gap, and no line is drawn across it.
_GAP_PERIODS = 5.0


def keep_peaks(
    t_s: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"], points: int
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"]]:
    """Thin a line out to the smallest and the largest sample of each stretch, at their own times.

    Args:
        t_s: Times, increasing [s]. Shape (n,).
        values: What is drawn; where it is not finite the line breaks. Shape (n,).
        points: About how many points to keep. With no more samples than that, all stay.

    Returns:
        Times and values, the first and the last sample among them, and a NaN in each gap of the times.
    """
    values = np.where(np.isfinite(values), values, np.nan)
    kept = np.arange(len(values)) if len(values) <= points else _extremes(values, max(points // 2, 1))
    steps_s = np.diff(t_s)
    gaps = np.flatnonzero(steps_s > _GAP_PERIODS * np.median(steps_s)) if len(steps_s) else np.zeros(0, np.int64)
    at = np.searchsorted(kept, gaps, side="right")
    middle_s = (t_s[gaps] + t_s[gaps + 1]) / 2.0
    return np.insert(t_s[kept], at, middle_s), np.insert(values[kept], at, np.nan)


def _extremes(values: Float[np.ndarray, " n"], stretches: int) -> np.ndarray:
    length = -(-len(values) // stretches)
    rows = np.full((-(-len(values) // length), length), np.nan)
    rows.ravel()[: len(values)] = values
    first = length * np.arange(len(rows))
    lowest = first + np.where(np.isnan(rows), np.inf, rows).argmin(axis=1)
    highest = first + np.where(np.isnan(rows), -np.inf, rows).argmax(axis=1)
    return np.unique(np.concatenate([[0], lowest, highest, [len(values) - 1]]))
