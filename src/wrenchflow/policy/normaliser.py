"""Scales each column to about [-1, 1], with floors, so that a column that hardly moves is not blown up."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wrenchflow.errors import DatasetError

OBSERVATION_BOUND = 3.0  # Observations beyond three times their usual range are held there.


@dataclass(frozen=True, kw_only=True)
class Normaliser:
    """z = (x - center) / scale, a column at a time, held within +-bound where there is a bound.

    Attributes:
        columns: Names of the columns, with units.
        center: Middle of each column's range, in its unit.
        scale: Half of each column's range, in its unit, and never less than half its floor.
        bound: Largest normalised value; None for actions, whose labels must not be changed.
    """

    columns: tuple[str, ...]
    center: tuple[float, ...]
    scale: tuple[float, ...]
    bound: float | None

    def __post_init__(self) -> None:
        if not len(self.columns) == len(self.center) == len(self.scale):
            raise DatasetError(
                f"normaliser has {len(self.columns)} columns, {len(self.center)} centers and {len(self.scale)} scales; "
                "one of each a column."
            )
        if not (np.isfinite(self.center).all() and np.isfinite(self.scale).all() and min(self.scale) > 0.0):
            raise DatasetError("normaliser has a center that is not finite, or a scale that is not positive.")


def fit_observations(values: Float[np.ndarray, "n d"], columns: Sequence[str], floors: Sequence[float]) -> Normaliser:
    """Fit by the 1 % and 99 % quantiles, so that one hard knock does not squeeze all other forces into a corner.

    Args:
        values: All training steps. Shape (n, d).
        columns: Names of the columns.
        floors: Smallest range to divide by, in each column's unit.

    Raises:
        DatasetError: If there is no step, or a value is not finite.
    """
    _require_finite(values, columns)
    low, high = np.quantile(values.astype(np.float64), [0.01, 0.99], axis=0)
    return _of_range(low, high, columns, floors, OBSERVATION_BOUND)


def fit_actions(values: Float[np.ndarray, "n d"], columns: Sequence[str], floors: Sequence[float]) -> Normaliser:
    """Fit by minimum and maximum, so that every label lies within [-1, 1], where the denoiser clips.

    Args:
        values: All training actions. Shape (n, d).
        columns: Names of the columns.
        floors: Smallest range to divide by, in each column's unit.

    Raises:
        DatasetError: If there is no step, or a value is not finite.
    """
    _require_finite(values, columns)
    exact = values.astype(np.float64)
    return _of_range(exact.min(axis=0), exact.max(axis=0), columns, floors, None)


def _require_finite(values: Float[np.ndarray, "n d"], columns: Sequence[str]) -> None:
    if len(values) == 0:
        raise DatasetError("there are no steps to fit a normaliser to.")
    finite = np.isfinite(values)
    if not finite.all():
        bad = [name for i, name in enumerate(columns) if not np.isfinite(values[:, i]).all()]
        raise DatasetError(f"the data set has values that are not finite in: {', '.join(bad)}.")


def _of_range(
    low: Float[np.ndarray, " d"],
    high: Float[np.ndarray, " d"],
    columns: Sequence[str],
    floors: Sequence[float],
    bound: float | None,
) -> Normaliser:
    scale = np.maximum(high - low, floors) / 2.0
    return Normaliser(
        columns=tuple(columns),
        center=tuple(((low + high) / 2.0).tolist()),
        scale=tuple(scale.tolist()),
        bound=bound,
    )
