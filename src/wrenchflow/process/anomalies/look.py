"""What every detector looks at: the raw reading, where the arm was free, and how much its sensor scatters."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int64

from wrenchflow.episode import Episode, Stream
from wrenchflow.rig import Rig
from wrenchflow.running_median import centred_median

HALF = 4  # Samples to either side that a running median looks at: what is as long is no spike.
MIN_FREE = 100  # Samples: with fewer of free motion, the whole reading has to tell the noise.
MAD_TO_SIGMA = 1.4826  # Of a normal distribution.


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

    @property
    def noise(self) -> Float[np.ndarray, " d"]:
        """What the rig says of the sensor's noise; what is smaller than that matters to nobody. Shape (d,)."""
        return self.rig.sensor.noise[: self.data.shape[1]]

    @property
    def where_sigma(self) -> str:
        """What `sigma` was found in."""
        return "free motion" if self.free.sum() >= MIN_FREE else "the whole reading"

    @cached_property
    def rough(self) -> Float[np.ndarray, "n d"]:
        """What a running median leaves: noise, vibration, spikes. Shape (n, d)."""
        return self.data - centred_median(self.data, 2 * HALF + 1)

    @cached_property
    def sigma(self) -> Float[np.ndarray, " d"]:
        """Robust standard deviation of `rough` in free motion, or of all where that is too little. Shape (d,)."""
        rows = self.rough[self.free] if self.free.sum() >= MIN_FREE else self.rough
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
