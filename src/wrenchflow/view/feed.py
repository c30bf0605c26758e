"""What goes from a control loop to the process that shows it, and how seldom."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from wrenchflow.camera import View
from wrenchflow.source import Source

ROWS_WAITING = 128  # Two seconds or so; what comes then is dropped.


class Decimation:
    """Lets something pass now and then."""

    def __init__(self, rate_hz: float) -> None:
        """Let it pass so often at most [Hz]."""
        self._period_ns = round(1e9 / rate_hz)
        self._due_ns = 0

    def passes(self, t_ns: int) -> bool:
        """Whether what was sampled at `t_ns` [ns] does; a clock that was set back begins anew."""
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
        views: Of the cameras.
        picture_rate_hz: Pictures that are shown of a view at most [Hz].
        meta: What is known at the start.
        save: The `.rrd` file to write; None for a viewer.
        port: Of the viewer, on the loopback.
        rings: Name of each source's ring, then of each view's.
    """

    id: str
    sources: tuple[Source, ...]
    views: tuple[View, ...]
    picture_rate_hz: float
    meta: Mapping[str, Any]
    save: Path | None
    port: int
    rings: tuple[str, ...]
