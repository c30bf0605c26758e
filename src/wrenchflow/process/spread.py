"""How far the force of demonstrations differs once they are aligned in time.

Dynamic time warping (Sakoe and Chiba, 1978) lays each curve over the others' median: two people who press alike, one of
them slowly, are alike here. The median is taken anew from the aligned curves (Petitjean and others, 2011, with a median
in place of a mean).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wrenchflow.compiled import kernel

POINTS = 100  # Of a curve.
_BAND = 20  # Points by which two curves may be shifted against each other.
_ROUNDS = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class AlignedCurves:
    """Force curves, each in the time of their median.

    Attributes:
        ids: The episodes.
        force_n: Norm of the force of each, aligned [N]. Shape (k, 100).
        median_n: Their median [N]. Shape (100,).
        low_n: A tenth of the curves lie below [N]. Shape (100,).
        high_n: A tenth of the curves lie above [N]. Shape (100,).
        distance_n: Root mean square distance of each to the median, by episode [N].
    """

    ids: tuple[str, ...]
    force_n: Float[np.ndarray, "k p"]
    median_n: Float[np.ndarray, " p"]
    low_n: Float[np.ndarray, " p"]
    high_n: Float[np.ndarray, " p"]
    distance_n: Mapping[str, float]


@kernel
def _warp(reference, curve, band, out):
    """Lay `curve` over `reference`: the mean of what dynamic time warping matches to each of its points."""
    n = reference.shape[0]
    cost = np.full((n + 1, n + 1), np.inf)
    cost[0, 0] = 0.0
    for i in range(1, n + 1):
        for j in range(max(1, i - band), min(n, i + band) + 1):
            step = (reference[i - 1] - curve[j - 1]) ** 2
            cost[i, j] = step + min(cost[i - 1, j - 1], cost[i - 1, j], cost[i, j - 1])
    count = np.zeros(n)
    for i in range(n):
        out[i] = 0.0
    i, j = n, n
    while i > 0 and j > 0:
        out[i - 1] += curve[j - 1]
        count[i - 1] += 1.0
        before, above, left = cost[i - 1, j - 1], cost[i - 1, j], cost[i, j - 1]
        if before <= above and before <= left:
            i, j = i - 1, j - 1
        elif above <= left:
            i -= 1
        else:
            j -= 1
    for k in range(n):
        out[k] /= count[k]


def align(curves: Mapping[str, Float[np.ndarray, " p"]]) -> AlignedCurves:
    """Align force curves with their median.

    Args:
        curves: Norm of the force at evenly spaced times, as many for each, by episode [N].
    """
    drawn = np.ascontiguousarray(np.stack(list(curves.values())), np.float64)
    aligned, median = drawn, np.median(drawn, axis=0)
    for _ in range(_ROUNDS):
        aligned = np.empty_like(drawn)
        for curve, out in zip(drawn, aligned, strict=True):
            _warp(median, curve, _BAND, out)
        median = np.median(aligned, axis=0)
    low, high = np.percentile(aligned, [10, 90], axis=0)
    distance_n = np.sqrt(((aligned - median) ** 2).mean(axis=1))
    return AlignedCurves(
        ids=tuple(curves),
        force_n=aligned,
        median_n=median,
        low_n=low,
        high_n=high,
        distance_n=dict(zip(curves, distance_n.tolist(), strict=True)),
    )
