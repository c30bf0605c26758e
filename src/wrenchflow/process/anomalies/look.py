"""What every detector looks at: the raw reading, where the arm was free, and how much its sensor scatters."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int64

from wrenchflow.compiled import kernel
from wrenchflow.episode import Episode, Stream
from wrenchflow.rig import Rig

HALF = 4  # Samples to either side that a running median looks at: what is as long is no spike.
MAD_TO_SIGMA = 1.4826  # Of a normal distribution.


@kernel
def _medians(data, half, out):
    """Running median of each column over 2 * half + 1 samples, fewer at the ends."""
    window = np.empty(2 * half + 1)
    for column in range(data.shape[1]):
        for i in range(data.shape[0]):
            first, last = max(i - half, 0), min(i + half + 1, data.shape[0])
            count = 0
            for row in range(first, last):
                value = data[row, column]
                at = count
                while at > 0 and window[at - 1] > value:
                    window[at] = window[at - 1]
                    at -= 1
                window[at] = value
                count += 1
            middle = count // 2
            out[i, column] = window[middle] if count % 2 else 0.5 * (window[middle - 1] + window[middle])


def running_median(data: Float[np.ndarray, "n d"], half: int = HALF) -> Float[np.ndarray, "n d"]:
    """Median of each sample and of `half` to either side, by columns. Shape (n, d)."""
    out = np.empty(data.shape)
    _medians(np.ascontiguousarray(data, np.float64), half, out)
    return out


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """A recording as a detector sees it.

    Attributes:
        episode: All of it.
        raw: Its `wrench_raw`, with rows that are not finite left out.
        rig: The robot cell.
        free: Whether each sample of `raw` lies in free motion, well away from any contact. Shape (n,).
    """

    episode: Episode
    raw: Stream
    rig: Rig
    free: Bool[np.ndarray, " n"]

    @property
    def t(self) -> Int64[np.ndarray, " n"]:
        """Stamps [ns]."""
        return self.raw.t

    @property
    def data(self) -> Float[np.ndarray, "n d"]:
        """The reading, sensor frame [N, N.m]."""
        return self.raw.data

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns."""
        return self.raw.signal.columns

    @property
    def units(self) -> tuple[str, ...]:
        """Their units."""
        return self.raw.signal.units

    @property
    def period_ns(self) -> int:
        """Nominal time between two samples [ns]."""
        return round(1e9 / self.rig.sensor.rate_hz)

    @cached_property
    def rough(self) -> Float[np.ndarray, "n d"]:
        """What a running median leaves: noise, vibration, spikes. Shape (n, d)."""
        return self.data - running_median(self.data)

    @cached_property
    def sigma(self) -> Float[np.ndarray, " d"]:
        """Robust standard deviation of `rough` in free motion, or of all where that is too little. Shape (d,)."""
        rows = self.rough[self.free] if self.free.sum() >= 100 else self.rough
        if not len(rows):
            return np.zeros(self.data.shape[1])
        return MAD_TO_SIGMA * np.median(np.abs(rows - np.median(rows, axis=0)), axis=0)

    def stop_ns(self, last: int) -> int:
        """Where a span ends whose last sample is `last` [ns]."""
        return int(self.t[last]) + self.period_ns


def runs_of(flags: Bool[np.ndarray, " n"]) -> list[tuple[int, int]]:
    """First and one past the last index of each run of True."""
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8))
    return list(zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True))
