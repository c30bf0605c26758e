"""What the data of an import say about themselves, beside what was assumed of them."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wrenchflow.episode import Stream

_GOOD_FIT = 0.99  # Of an axis that moved enough to tell the time between two samples.
_FEWEST = 10


@dataclass(frozen=True, kw_only=True)
class StreamFigures:
    """The sampling of a stream.

    Attributes:
        samples: How many.
        median_step_ms: Between two stamps; None for fewer than two samples, like all that follows.
        shortest_step_ms: The same.
        longest_step_ms: The same.
        mean_rate_hz: Steps by the time that they take together.
        repeated_rows: Rows whose every value is that of the one before.
    """

    samples: int
    median_step_ms: float | None = None
    shortest_step_ms: float | None = None
    longest_step_ms: float | None = None
    mean_rate_hz: float | None = None
    repeated_rows: int = 0


def figures_of(stream: Stream) -> StreamFigures:
    """Look at the sampling of a stream."""
    if len(stream) < 2:
        return StreamFigures(samples=len(stream))
    steps_ms = np.diff(stream.t) * 1e-6
    return StreamFigures(
        samples=len(stream),
        median_step_ms=float(np.median(steps_ms)),
        shortest_step_ms=float(steps_ms.min()),
        longest_step_ms=float(steps_ms.max()),
        mean_rate_hz=stream.rate_hz,
        repeated_rows=int((stream.data[1:] == stream.data[:-1]).all(axis=1).sum()),
    )


@dataclass(frozen=True, kw_only=True)
class RateEstimate:
    """How much time passes between two samples, if a velocity is the slope of a position.

    Attributes:
        position: Name of the position's stream.
        velocity: Name of the velocity's.
        step_ms: Along each axis; None where it did not move, or does not fit. Length 3.
        r_squared: How well the position follows, likewise.
        rate_hz: By the median of the axes that fit; None if none does.
    """

    position: str
    velocity: str
    step_ms: tuple[float | None, ...]
    r_squared: tuple[float | None, ...]
    rate_hz: float | None


def estimate_rate(streams: Mapping[str, Stream]) -> RateEstimate | None:
    """Estimate the rate of streams that were taken row by row, from a position and its velocity.

    Returns:
        The estimate; None if there is no such pair of equal length in the same frame.
    """
    for name, position in streams.items():
        for other, velocity in streams.items():
            is_pair = position.signal.kind in ("position", "pose") and velocity.signal.kind in ("velocity", "twist")
            if is_pair and position.frame == velocity.frame and len(position) == len(velocity) >= _FEWEST:
                return _fit(name, other, position.data[:, :3], velocity.data[:, :3])
    return None


def _fit(
    name: str, other: str, position_m: Float[np.ndarray, "n 3"], velocity_m_s: Float[np.ndarray, "n 3"]
) -> RateEstimate:
    steps_ms: list[float | None] = []
    fits: list[float | None] = []
    for place, speed in zip(position_m.T, velocity_m_s.T, strict=True):
        # The trapezoidal sum of the velocities is the way in units of a step.
        way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))])
        way, gone = way - way.mean(), place - place.mean()
        moved, spread = float(way @ way), float(gone @ gone)
        if not (np.isfinite(moved) and np.isfinite(spread) and moved > 0.0 and spread > 0.0):
            steps_ms.append(None)
            fits.append(None)
            continue
        step_s = float(way @ gone) / moved
        left = gone - step_s * way
        steps_ms.append(1e3 * step_s)
        fits.append(1.0 - float(left @ left) / spread)
    good = [
        step_ms
        for step_ms, fit in zip(steps_ms, fits, strict=True)
        if step_ms is not None and fit is not None and fit >= _GOOD_FIT and step_ms > 0.0
    ]
    return RateEstimate(
        position=name,
        velocity=other,
        step_ms=tuple(steps_ms),
        r_squared=tuple(fits),
        rate_hz=1e3 / float(np.median(good)) if good else None,
    )
