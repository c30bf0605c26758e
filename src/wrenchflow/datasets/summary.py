"""The ten statistics that LeRobot keeps of every feature, computed exactly from all values."""

import numpy as np

from wrenchflow.datasets.quantiles import Ranks

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
    # Along contiguous columns numpy is several times as fast as across them.
    columns = np.ascontiguousarray(rows_of(values).T)
    count = columns.shape[1]
    ranks = Ranks.of(count, tuple(QUANTILES.values()))
    sought = np.unique([0, *ranks.rows, count - 1])
    parted = np.partition(columns, sought, axis=1)
    # Stamps are too large for float64, but the time since the first of them is not.
    offset = (
        np.zeros((len(columns), 1)) if np.issubdtype(columns.dtype, np.floating) else parted[:, :1].astype(np.int64)
    )
    shifted = (columns - offset).astype(np.float64)
    mean = shifted.mean(axis=1)
    shifted -= mean[:, None]
    return {
        "min": parted[:, 0],
        "max": parted[:, -1],
        "mean": mean + offset[:, 0],
        "std": np.sqrt(np.einsum("ij,ij->i", shifted, shifted) / count),
        "count": np.array([len(values)], np.int64),
        **dict(zip(QUANTILES, ranks.quantiles(parted[:, ranks.rows].T), strict=True)),
    }
