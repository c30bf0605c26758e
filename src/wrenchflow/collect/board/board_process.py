"""The process that draws a board while somebody demonstrates: it drains the ring, and is told the rest."""

import multiprocessing
import os
import sys
import time
from multiprocessing.connection import Connection, wait
from typing import Any

import numpy as np
from rich.console import Console
from rich.live import Live
from rich.text import Text

from wrenchflow.collect.board.live_board import Job
from wrenchflow.collect.board.look import look
from wrenchflow.collect.board.row import ROW, ROWS_WAITING
from wrenchflow.collect.board.tally import told
from wrenchflow.collect.board.tone import Tone
from wrenchflow.recording.child import leave_signals_to_parent
from wrenchflow.recording.ring import Ring

_POLL_S = 0.1
_NICENESS = 10  # Less urgent than the control loop.
_RATE_S = 1.0  # Over which the rate is counted.


def run_board(job: Job, control: Connection) -> None:
    """Draw until told to finish, or until nobody is there who could tell."""
    leave_signals_to_parent()
    os.nice(_NICENESS)
    parent = multiprocessing.parent_process()
    assert parent is not None
    ring = Ring.attach(job.ring, ROW, ROWS_WAITING)
    live = Live(console=Console(file=sys.stderr), auto_refresh=False, transient=True, redirect_stdout=False)
    drawn = _Drawn(job, live, Tone() if job.has_sound else None)
    try:
        with live:
            is_over = False
            while not is_over:
                wait([control, parent.sentinel], _POLL_S)
                drawn.see(ring.take())  # First, for they are of what was, whatever is told now.
                while not is_over and control.poll():
                    try:
                        is_over = drawn.hear(*control.recv())
                    except (EOFError, OSError):
                        is_over = True
                is_over = is_over or not parent.is_alive()
                drawn.draw()
    finally:
        ring.close()
        if not parent.is_alive():
            ring.unlink()


class _Drawn:
    """What is known, and where it is drawn."""

    def __init__(self, job: Job, live: Live, tone: Tone | None) -> None:
        self._facts, self._tally, self._live, self._tone = job.facts, job.tally, live, tone
        self._id = self._question = ""
        self._row: np.void | None = None
        self._rate_hz, self._from_s, self._from_tick = 0.0, 0.0, 0

    def hear(self, what: str, value: Any) -> bool:
        """Take in what happened; returns whether it is over."""
        if what in ("begin", "add", "discard"):
            self._row, self._rate_hz, self._from_s = None, 0.0, 0.0  # Of an attempt that is over.
        if what == "begin":
            self._id = str(value)
        elif what == "add":
            self._tally = self._tally.with_(value)
            if not value.was_there:
                self._say(f"{self._tally.kept} of {self._tally.total}  {told(value)}")
        elif what == "discard":
            self._tally = self._tally.without(value)
            self._say(f"discarded  {told(value)}")
        elif what == "say":
            self._say(str(value))
        elif what == "ask":
            self._question = str(value)
        return what == "finish"

    def see(self, rows: np.ndarray) -> None:
        """Take in the newest of some rows."""
        if len(rows):
            self._row = rows[-1]
            self._count(int(rows[-1]["tick"]))
            if self._tone is not None:
                self._tone.hear(float(np.linalg.norm(rows[-1]["wrench"][:3])) / self._facts.limit_n)

    def draw(self) -> None:
        """Draw all of it."""
        picture = look(self._facts, self._tally, self._id, self._row, self._rate_hz, self._question)
        self._live.update(picture, refresh=True)

    def _count(self, tick: int) -> None:
        now_s = time.monotonic()
        if not self._from_s or tick < self._from_tick:
            self._from_s, self._from_tick = now_s, tick
        elif now_s - self._from_s >= _RATE_S:
            self._rate_hz = (tick - self._from_tick) / (now_s - self._from_s)
            self._from_s, self._from_tick = now_s, tick

    def _say(self, text: str) -> None:
        self._live.console.print(Text(text))
