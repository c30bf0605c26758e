"""Statistics of pictures: how often each brightness is there says all of them, exactly."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Int64, UInt8

from wrenchflow.compiled import kernel
from wrenchflow.datasets.quantiles import Ranks
from wrenchflow.datasets.summary import QUANTILES

_LEVELS = 256


def _none() -> Int64[np.ndarray, "3 256"]:
    return np.zeros((3, _LEVELS), np.int64)


@dataclass(frozen=True, eq=False)
class PixelCounts:
    """How often each brightness occurs.

    Attributes:
        of: By channel (red, green, blue) and brightness. Shape (3, 256).
        pictures: How many were counted.
    """

    of: Int64[np.ndarray, "3 256"] = field(default_factory=_none)
    pictures: int = 0

    def with_(self, pixels: UInt8[np.ndarray, "height width 3"]) -> "PixelCounts":
        """Those with another picture."""
        counts = self.of.copy()
        _count(np.ascontiguousarray(pixels).reshape(-1, 3), counts)
        return PixelCounts(counts, self.pictures + 1)

    def __add__(self, other: "PixelCounts") -> "PixelCounts":
        return PixelCounts(self.of + other.of, self.pictures + other.pictures)

    def summary(self) -> dict[str, np.ndarray]:
        """LeRobot's ten statistics, of brightness from 0 to 1: shape (3, 1, 1), and `count` (1,), of pictures."""
        count = int(self.of[0].sum())
        level = np.arange(_LEVELS) / (_LEVELS - 1)
        ranks = Ranks.of(count, tuple(QUANTILES.values()))
        upto = np.cumsum(self.of, axis=1)
        at_rank = np.array([level[np.searchsorted(channel, ranks.rows, side="right")] for channel in upto]).T
        there = self.of > 0
        mean = self.of @ level / count
        found = {
            "min": level[there.argmax(axis=1)],
            "max": level[_LEVELS - 1 - there[:, ::-1].argmax(axis=1)],
            "mean": mean,
            "std": np.sqrt(np.maximum(self.of @ level**2 / count - mean**2, 0.0)),
            **dict(zip(QUANTILES, ranks.quantiles(at_rank), strict=True)),
        }
        shaped = {name: values.reshape(3, 1, 1) for name, values in found.items()}
        return {**shaped, "count": np.array([self.pictures], np.int64)}


@kernel
def _count(pixels, counts):
    for i in range(pixels.shape[0]):
        for channel in range(3):
            counts[channel, pixels[i, channel]] += 1
