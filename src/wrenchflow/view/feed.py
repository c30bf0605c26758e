"""Between a control loop and the process that shows it: rings, and how seldom something goes into them."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wrenchflow.recording.ring import Ring
from wrenchflow.source import Source

IMAGE_BYTES = 256 * 1024
IMAGE = np.dtype([("t_ns", "i8"), ("size", "i8"), ("data", "u1", (IMAGE_BYTES,))])
CAPACITY, IMAGE_CAPACITY = 128, 8  # Two seconds or so, until what comes is dropped.


class Feed:
    """The end of a ring into which something goes now and then.

    Attributes:
        ring: Where it goes.
    """

    def __init__(self, ring: Ring, rate_hz: float) -> None:
        """Feed a ring at most so often [Hz]."""
        self.ring = ring
        self._period_ns = round(1e9 / rate_hz)
        self._due_ns = 0

    def is_due(self, t_ns: int) -> bool:
        """Whether what was sampled at `t_ns` is to go in; a clock that was set back begins anew."""
        if self._due_ns - self._period_ns <= t_ns < self._due_ns:
            return False
        self._due_ns = t_ns + self._period_ns
        return True


@dataclass(frozen=True, kw_only=True)
class Job:
    """What is shown, and where it comes from; travels to the process that logs.

    Attributes:
        id: Name of the episode.
        sources: Whose rows are shown.
        cameras: Names of the topics with images.
        meta: What is known at the start.
        save: The `.rrd` file to write; None for a viewer.
        port: Of the viewer, on the loopback.
        rings: Name of each source's ring, then of each camera's.
    """

    id: str
    sources: tuple[Source, ...]
    cameras: tuple[str, ...]
    meta: Mapping[str, Any]
    save: Path | None
    port: int
    rings: tuple[str, ...]
