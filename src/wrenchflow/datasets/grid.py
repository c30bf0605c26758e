"""The grid that steps lie on: at a rate, which may be any fraction, or where a camera took its pictures."""

from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np
from jaxtyping import Int64

from wrenchflow.clock import SECOND_NS
from wrenchflow.errors import ConfigError
from wrenchflow.observation import OBSERVATIONS

DEFAULT_RATE_HZ = Fraction(20)

Gaps = Literal["split", "mark", "refuse"]


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Where the steps of an episode lie, and what comes along.

    Attributes:
        rate_hz: Steps a second; with a camera, what its pictures are nominally taken at.
        camera: The camera whose pictures are the steps; empty for steps at `rate_hz`.
        cameras: Cameras whose pictures go along.
        observations: Which of `observation.OBSERVATIONS` are sampled.
        gaps: What becomes of steps without the samples that they need: they divide the episode (`split`), they are kept
            with the values before and marked as not valid (`mark`), or the episode is refused (`refuse`).
    """

    rate_hz: Fraction = DEFAULT_RATE_HZ
    camera: str = ""
    cameras: tuple[str, ...] = ()
    observations: tuple[str, ...] = tuple(OBSERVATIONS)
    gaps: Gaps = "split"

    def __post_init__(self) -> None:
        if not 0 < self.rate_hz <= 1000:
            raise ConfigError(f"a policy runs at more than 0 and at most 1000 Hz, got {float(self.rate_hz):g} Hz.")

    @property
    def period_ns(self) -> int:
        """Nominal time between steps [ns], rounded."""
        return round(SECOND_NS / self.rate_hz)

    def times(self, start_ns: int, stop_ns: int) -> Int64[np.ndarray, " n"]:
        """Stamps from `start_ns` to `stop_ns` at most, each rounded by itself: no rate drifts [ns]."""
        count = int((stop_ns - start_ns) * self.rate_hz / SECOND_NS) + 2
        step, over = SECOND_NS * self.rate_hz.denominator, self.rate_hz.numerator
        t = start_ns + (np.arange(count, dtype=np.int64) * step + over // 2) // over
        return t[t <= stop_ns]


def rate_of(period_ns: int) -> Fraction:
    """The rate [Hz] that a period stands for: 33333333 ns is 30 Hz, 33366667 ns is 30000/1001 Hz."""
    return Fraction(SECOND_NS, period_ns).limit_denominator(1001)
