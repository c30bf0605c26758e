"""What keeps time: it stores each tick's row, tells who watches, and waits for the next."""

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from wrenchflow.collect.sources import CONTROL, DEVICE, GOAL
from wrenchflow.control.controller import TICK_NS
from wrenchflow.recording.recorder import Recorder
from wrenchflow.sim.state import Looks
from wrenchflow.sim.streams import COLUMNS
from wrenchflow.source import Source

if TYPE_CHECKING:
    from wrenchflow.view.live import LiveView

_SPIN_NS = 150_000  # A sleep ends late; the last of it is spent awake.


class Beat:
    """Called after each tick: stores its row, and waits for the next.

    Attributes:
        recorder: Where rows go.
        offset_ns: From virtual time to the recorder's clock [ns], told at the first tick.
        late: Ticks that began more than a millisecond after their time.
        watchers: Who is told of each tick that is over, by how many there have been.
    """

    def __init__(self, recorder: Recorder, control: Source, looks: Looks | None, show: "LiveView | None") -> None:
        self.recorder, self.offset_ns, self.late = recorder, 0, 0
        self._looks, self._show = looks, show
        self.watchers: tuple[Callable[[int], None], ...] = ()
        self._start_ns = self._ticks = 0
        self._rows = {source.name: np.zeros(1, source.dtype) for source in (control, DEVICE, GOAL)}
        self._counts = dict.fromkeys(self._rows, 0)

    def __call__(self, rows: np.ndarray) -> None:
        """Store the row of a tick that is over."""
        row = rows[-1]
        if not self._ticks:
            self._start_ns = time.monotonic_ns()
            self.offset_ns = self.recorder.clock.at_ns(self._start_ns) - int(row["t_ns"])
        self._ticks += 1
        if self._looks is not None:
            self._looks.into(self._rows[CONTROL.name]["looks"][0])
        self.store(CONTROL, int(row["t_ns"]), **{column.name: row[column.name] for column in COLUMNS})
        for watch in self.watchers:
            watch(self._ticks)
        self._wait(self._start_ns + self._ticks * TICK_NS)

    def store(self, source: Source, t_ns: int, **values: np.ndarray) -> None:
        """Store a row that was sampled at `t_ns` of virtual time."""
        row = self._rows[source.name]
        row["t_ns"] = t_ns + self.offset_ns
        row["received_ns"] = self.recorder.clock.now_ns()
        row["sequence"] = self._counts[source.name]
        self._counts[source.name] += 1
        for name, value in values.items():
            row[name] = value
        self.recorder.push(source.name, row)
        if self._show is not None:
            self._show.push(source.name, row)

    def _wait(self, until_ns: int) -> None:
        left_ns = until_ns - time.monotonic_ns()
        if left_ns < -TICK_NS:
            self.late += 1
        if left_ns > _SPIN_NS:
            time.sleep((left_ns - _SPIN_NS) * 1e-9)
        while time.monotonic_ns() < until_ns:
            pass
