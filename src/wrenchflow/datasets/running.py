"""LeRobot's ten statistics of a feature, of episodes that come one after the other and are not kept."""

from collections.abc import Iterable, Mapping

import numpy as np

from wrenchflow.datasets.quantiles import Blocks, quantiles_of
from wrenchflow.datasets.summary import QUANTILES, rows_of


class Running:
    """Least, greatest, mean and deviation so far; quantiles need another look at all, which `result` takes."""

    def __init__(self) -> None:
        self._lowest = self._highest = self._origin = np.zeros(0)
        self._rows = self._steps = 0
        self._sum = self._squares = np.zeros(0)

    def add(self, values: np.ndarray, summary: Mapping[str, np.ndarray]) -> None:
        """Take in an episode.

        Args:
            values: One value a step. Shape (T,), (T, d) or (T, n, d).
            summary: What `summary.summarise` says of them.
        """
        rows = len(rows_of(values))
        if not self._rows:
            self._lowest, self._highest = summary["min"], summary["max"]
            self._origin = summary["mean"]
            self._sum, self._squares = np.zeros_like(self._origin), np.zeros_like(self._origin)
        self._lowest = np.minimum(self._lowest, summary["min"])
        self._highest = np.maximum(self._highest, summary["max"])
        # Differences from the first mean: sums of stamps would be too large, and squares of far numbers cancel.
        apart = summary["mean"] - self._origin
        self._sum += rows * apart
        self._squares += rows * (summary["std"] ** 2 + apart**2)
        self._rows += rows
        self._steps += len(values)

    def moments(self) -> dict[str, np.ndarray]:
        """`min max mean std count`, which need no second look."""
        mean = self._sum / self._rows
        variance = np.maximum(self._squares / self._rows - mean * mean, 0.0)
        return {
            "min": self._lowest,
            "max": self._highest,
            "mean": self._origin + mean,
            "std": np.sqrt(variance),
            "count": np.array([self._steps], np.int64),
        }

    def result(self, again: Blocks) -> dict[str, np.ndarray]:
        """The statistics, as `summary.summarise` has them.

        Args:
            again: All values that were added, in parts of shape (T, ...), as often as it is called.
        """

        def parts() -> Iterable[np.ndarray]:
            return (rows_of(part) for part in again())

        quantiles = quantiles_of(parts, self._lowest, self._highest, self._rows, list(QUANTILES.values()))
        return self.moments() | dict(zip(QUANTILES, quantiles, strict=True))
