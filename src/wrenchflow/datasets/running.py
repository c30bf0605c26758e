"""LeRobot's ten statistics of a feature, of episodes that come one after the other and are not kept."""

from collections.abc import Iterable

import numpy as np

from wrenchflow.datasets.quantiles import Blocks, quantiles_of
from wrenchflow.datasets.summary import QUANTILES, rows_of


class Running:
    """Least, greatest, mean and deviation so far; quantiles need another look at all, which `result` takes."""

    def __init__(self, values: np.ndarray) -> None:
        rows = rows_of(values)
        # Sums are of differences from the first value: stamps are too large for float64, and squares cancel.
        self._origin = rows[0]
        self._lowest, self._highest = rows[0].copy(), rows[0].copy()
        self._sum, self._squares = np.zeros(rows.shape[1]), np.zeros(rows.shape[1])
        self._rows = self._steps = 0

    def add(self, values: np.ndarray) -> None:
        """Take in one value a step. Shape (T,), (T, d) or (T, n, d)."""
        rows = rows_of(values)
        self._lowest = np.minimum(self._lowest, rows.min(axis=0))
        self._highest = np.maximum(self._highest, rows.max(axis=0))
        wide = np.int64 if self._origin.dtype.kind in "bi" else np.float64
        apart = (rows.astype(wide) - self._origin.astype(wide)).astype(np.float64)
        self._sum += apart.sum(axis=0)
        self._squares += (apart * apart).sum(axis=0)
        self._rows += len(rows)
        self._steps += len(values)

    def result(self, again: Blocks) -> dict[str, np.ndarray]:
        """The statistics, as `summary.summarise` has them.

        Args:
            again: All values that were added, in parts of shape (T, ...), as often as it is called.
        """

        def parts() -> Iterable[np.ndarray]:
            return (rows_of(part) for part in again())

        mean = self._sum / self._rows
        variance = np.maximum(self._squares / self._rows - mean * mean, 0.0)
        quantiles = quantiles_of(parts, self._lowest, self._highest, self._rows, list(QUANTILES.values()))
        return {
            "min": self._lowest,
            "max": self._highest,
            "mean": self._origin + mean,
            "std": np.sqrt(variance),
            "count": np.array([self._steps], np.int64),
            **dict(zip(QUANTILES, quantiles, strict=True)),
        }
