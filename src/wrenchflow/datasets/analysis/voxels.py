"""Where in the workspace the tool has been: cells of a grid, each by one number, so that they can be counted."""

import numpy as np
from jaxtyping import Float, Int64

_BITS = 20  # Of a cell's place along an axis.
_MIDDLE = 1 << (_BITS - 1)


def voxels_of(
    position_m: Float[np.ndarray, "n 3"] | None, voxel_m: float
) -> tuple[Int64[np.ndarray, " k"], Int64[np.ndarray, " k"]]:
    """Cells that some positions lie in, and how many lie in each.

    Args:
        position_m: Positions [m]; those that are not finite lie nowhere. Shape (n, 3).
        voxel_m: Edge of a cell [m].
    """
    if position_m is None or not len(position_m):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    finite = np.isfinite(position_m).all(axis=1)
    rows = position_m if finite.all() else position_m[finite]
    at = np.clip(np.floor(rows / voxel_m), -_MIDDLE, _MIDDLE - 1).astype(np.int64) + _MIDDLE
    numbers = (at[:, 0] << (2 * _BITS)) | (at[:, 1] << _BITS) | at[:, 2]
    return np.unique(numbers, return_counts=True)


def places_of(voxels: Int64[np.ndarray, " k"]) -> Int64[np.ndarray, "k 3"]:
    """Along each axis, the number of each cell; cell 0 begins at 0 m. Shape (k, 3)."""
    of = (1 << _BITS) - 1
    return np.stack([voxels >> (2 * _BITS), (voxels >> _BITS) & of, voxels & of], axis=1) - _MIDDLE


class Workspace:
    """Counts the cells of many episodes."""

    def __init__(self) -> None:
        self._visits: dict[int, int] = {}
        self._episodes: dict[int, int] = {}

    def add(self, voxels: Int64[np.ndarray, " k"], visits: Int64[np.ndarray, " k"]) -> None:
        """Take in an episode."""
        for cell, count in zip(voxels.tolist(), visits.tolist(), strict=True):
            self._visits[cell] = self._visits.get(cell, 0) + count
            self._episodes[cell] = self._episodes.get(cell, 0) + 1

    def __len__(self) -> int:
        return len(self._visits)

    @property
    def cells(self) -> Int64[np.ndarray, "k 3"]:
        """All cells. Shape (k, 3)."""
        return places_of(np.fromiter(self._visits, np.int64, len(self._visits)))

    @property
    def visits(self) -> Int64[np.ndarray, " k"]:
        """Steps in each. Shape (k,)."""
        return np.fromiter(self._visits.values(), np.int64, len(self._visits))

    @property
    def seen_once(self) -> float:
        """Share of the cells that one episode alone has been in; NaN without any."""
        return float(np.mean([count == 1 for count in self._episodes.values()])) if self._episodes else float("nan")
