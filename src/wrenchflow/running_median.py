"""The running median of the last samples, which takes out spikes and leaves steps as steep as they are."""

import numpy as np
from jaxtyping import Float

from wrenchflow.compiled import kernel


@kernel
def _median_rows(ring, scratch, place, running, rows, out):
    length = ring.shape[0]
    for i in range(rows.shape[0]):
        finite = True
        for column in range(rows.shape[1]):
            finite = finite and np.isfinite(rows[i, column])
        if not finite:
            running = False
            for column in range(rows.shape[1]):
                out[i, column] = np.nan
            continue
        if not running:  # As if the first sample had been coming in forever.
            for k in range(length):
                for column in range(rows.shape[1]):
                    ring[k, column] = rows[i, column]
            running = True
        for column in range(rows.shape[1]):
            ring[place, column] = rows[i, column]
            for k in range(length):  # Insertion sort: windows are short.
                value, at = ring[k, column], k
                while at > 0 and scratch[at - 1] > value:
                    scratch[at] = scratch[at - 1]
                    at -= 1
                scratch[at] = value
            out[i, column] = scratch[length // 2]
        place = (place + 1) % length
    return place, running


class CausalMedian:
    """The median of the last `samples`, column by column; it starts as if its first sample had come in forever.

    A row that is not finite comes out as NaN and ends a run of samples, as in `filtering.CausalLowpass`.
    """

    def __init__(self, samples: int, width: int = 6) -> None:
        """Prepare for `width` columns; `samples` is odd."""
        if samples < 1 or samples % 2 == 0:
            raise ValueError(f"expected an odd number of samples, got {samples}.")
        self._ring = np.zeros((samples, width))
        self._scratch = np.zeros(samples)
        self._place, self._running = 0, False

    def push(self, rows: Float[np.ndarray, "n d"]) -> Float[np.ndarray, "n d"]:
        """Work off the next samples. Shape (n, width), in the units that came in."""
        rows = np.ascontiguousarray(rows, np.float64)
        if rows.ndim != 2 or rows.shape[1] != self._ring.shape[1]:
            raise ValueError(f"expected rows of {self._ring.shape[1]} columns, got an array of shape {rows.shape}.")
        out = np.empty_like(rows)
        state = self._ring, self._scratch, self._place, self._running
        self._place, self._running = _median_rows(*state, rows, out)
        return out

    def restart(self) -> None:
        """Forget everything: the next sample starts a new run, as after a gap."""
        self._running = False


def centred_median(data: Float[np.ndarray, "n d"], samples: int) -> Float[np.ndarray, "n d"]:
    """The median of as many finite samples before as after each, the ends repeated: without lag, and causal no more."""
    if not len(data):
        return data.copy()
    ahead = samples // 2
    rows = CausalMedian(samples, data.shape[1]).push(np.concatenate([data, np.repeat(data[-1:], ahead, axis=0)]))
    return rows[ahead:]
