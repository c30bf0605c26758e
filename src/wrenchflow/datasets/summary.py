"""The ten statistics that LeRobot keeps of every feature, computed exactly from all values."""

import numpy as np

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}


def rows_of(values: np.ndarray) -> np.ndarray:
    """Values by column: a step may hold one, a row of them, or many rows. Shape (rows, d)."""
    return values.reshape(-1, values.shape[-1] if values.ndim > 1 else 1)


def summarise(values: np.ndarray) -> dict[str, np.ndarray]:
    """Statistics of a feature over its steps and, where a step holds many rows, over these too.

    Args:
        values: One value a step. Shape (T,), (T, d) or (T, n, d).

    Returns:
        `min max mean std q01 q10 q50 q90 q99` of shape (d,), and `count` (1,), the number of steps. `min` and `max`
        keep the kind of number that came in; `std` is that of the population.
    """
    rows = rows_of(values)
    lowest, highest = rows.min(axis=0), rows.max(axis=0)
    # Stamps are too large for float64, but the time since the first of them is not.
    offset = np.zeros_like(lowest) if np.issubdtype(rows.dtype, np.floating) else lowest.astype(np.int64)
    shifted = (rows - offset).astype(np.float64)
    quantiles = np.quantile(shifted, list(QUANTILES.values()), axis=0)
    return {
        "min": lowest,
        "max": highest,
        "mean": shifted.mean(axis=0) + offset,
        "std": shifted.std(axis=0),
        "count": np.array([len(values)], np.int64),
        **{name: row + offset for name, row in zip(QUANTILES, quantiles, strict=True)},
    }
