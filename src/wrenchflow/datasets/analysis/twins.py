"""Near duplicates: episodes whose arms went through the same postures, as copies and re-uploads do."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchflow.datasets.analysis.config import AnalysisConfig
from wrenchflow.datasets.analysis.figures import EpisodeFigures

# Two episodes that do not move are alike without being copies.
_STILL = 3.0


@dataclass(frozen=True, kw_only=True)
class Twins:
    """Two episodes that are nearly the same.

    Attributes:
        first: Number of the one that comes first.
        second: Number of the other.
        apart: Root mean square distance of their postures, in [rad] of joints or [m] of positions.
        of: What was compared: `joints` or `position`.
    """

    first: int
    second: int
    apart: float
    of: str


def find_twins(episodes: Sequence[EpisodeFigures], config: AnalysisConfig) -> tuple[Twins, ...]:
    """All pairs of episodes whose postures at 16 evenly spaced times lie closer than the configuration's limits.

    No pair is missed: along any direction two shapes lie no farther apart than they are. So only neighbours along the
    direction in which shapes differ most are compared, which is about linear in the number of episodes.
    """
    found: list[Twins] = []
    kinds = {(each.shape_of, len(each.shape)) for each in episodes if len(each.shape)}
    for of, size in sorted(kinds):
        numbers = [i for i, each in enumerate(episodes) if (each.shape_of, len(each.shape)) == (of, size)]
        limit = config.twin_rad if of == "joints" else config.twin_m
        shapes = np.stack([episodes[i].shape for i in numbers]).astype(np.float64)
        moved = np.ptp(shapes.reshape(len(shapes), 16, -1), axis=1).max(axis=1)
        moving = moved > _STILL * limit
        kept = [number for number, moves in zip(numbers, moving, strict=True) if moves]
        found += [
            Twins(first=min(kept[a], kept[b]), second=max(kept[a], kept[b]), apart=apart, of=of)
            for a, b, apart in _close(shapes[moving], limit)
        ]
    return tuple(sorted(found, key=lambda pair: (pair.first, pair.second)))


def _close(shapes: np.ndarray, limit: float) -> list[tuple[int, int, float]]:
    """Pairs of rows whose root mean square distance is less than `limit`, and that distance."""
    if len(shapes) < 2:
        return []
    centred = shapes - shapes.mean(axis=0)
    # The direction in which they differ most, from their covariance: rows may be very many, columns are few.
    direction = np.linalg.eigh(centred.T @ centred)[1][:, -1]
    along = centred @ direction
    order = np.argsort(along, kind="stable")
    reach = limit * np.sqrt(shapes.shape[1])
    last = np.searchsorted(along[order], along[order] + reach, side="right")
    pairs = []
    for i, a in enumerate(order):
        others = order[i + 1 : last[i]]
        if len(others):
            apart = np.sqrt(((shapes[others] - shapes[a]) ** 2).mean(axis=1))
            pairs += [(int(a), int(b), float(d)) for b, d in zip(others, apart, strict=True) if d < limit]
    return pairs
