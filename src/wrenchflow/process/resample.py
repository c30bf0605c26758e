"""An even grid under a reading that comes unevenly; only where somebody asked for it."""

from dataclasses import replace

import numpy as np

from wrenchflow.episode import Stream
from wrenchflow.errors import StreamError
from wrenchflow.process.stamps import GAP_PERIODS, finite

# A slower grid would fold what lies above half its rate into the force.
_SLOWEST = 0.9


def resampled(stream: Stream, rate_hz: float, name: str) -> Stream:
    """Put a stream on an even grid, by straight lines between its samples.

    What lies between two samples that are further apart than one and a half of the usual step and of the grid's is a
    gap, and has no samples. Rows that are not finite are none.

    Args:
        stream: Any.
        rate_hz: Of the grid [Hz].
        name: Of the stream, for the message.

    Raises:
        StreamError: If it has fewer than two samples, or the grid is slower than they come.
    """
    known = finite(stream)
    if len(known) < 2:
        raise StreamError(f"stream '{name}' has {len(known)} finite samples, expected 2 at least to resample it.")
    if rate_hz < _SLOWEST * known.rate_hz:
        raise StreamError(
            f"stream '{name}' comes at {known.rate_hz:.4g} Hz on average, and a grid of {rate_hz:g} Hz would fold its "
            f"faster part into the slower one: expected {_SLOWEST * known.rate_hz:.4g} Hz at least."
        )
    period_ns = 1e9 / rate_hz
    t, steps_ns = known.t, np.diff(known.t)
    count = int((t[-1] - t[0]) / period_ns) + 1
    grid = t[0] + np.round(np.arange(count) * period_ns).astype(np.int64)
    before = np.clip(np.searchsorted(t, grid, side="right") - 1, 0, len(t) - 2)
    longest_ns = GAP_PERIODS * max(float(np.median(steps_ns)), period_ns)
    inside = (steps_ns[before] <= longest_ns) | (grid == t[before]) | (grid == t[before + 1])
    grid, before = grid[inside], before[inside]
    share = ((grid - t[before]) / steps_ns[before])[:, None]
    rows = (1.0 - share) * known.data[before] + share * known.data[before + 1]
    return replace(known, t=grid, data=rows)
