"""A window on the scene while somebody demonstrates: fed thirty times a second, drawn by a process of its own."""

import logging
import multiprocessing
import os
import sys
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from types import TracebackType

import numpy as np

from wrenchflow.errors import WrenchflowError
from wrenchflow.recording.child import leave_signals_to_parent
from wrenchflow.recording.ring import Ring
from wrenchflow.sim.state import Looks

EVERY_TICKS = 33
_ROWS_WAITING = 8
_POLL_S = 0.01
_START_S, _FINISH_S = 30.0, 5.0
_NICENESS = 5  # Less urgent than the control loop.


def can_be_seen() -> bool:
    """Whether there is a display to open a window on."""
    return sys.platform != "linux" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


@dataclass(frozen=True, kw_only=True)
class _Job:
    model: bytes
    ring: str
    size: int


class SceneViewer:
    """MuJoCo's viewer, fed by a control loop that never waits for it; if it dies or is closed, nothing else happens."""

    def __init__(self, model: bytes, size: int) -> None:
        """Start the process.

        Args:
            model: As `sim.state.model_bytes` gives it.
            size: How many numbers say what a scene looks like.
        """
        self._ring = Ring.create(_row(size), _ROWS_WAITING)
        self._row = np.zeros(1, _row(size))
        job = _Job(model=model, ring=self._ring.name, size=size)
        context = multiprocessing.get_context("spawn")
        self._control, theirs = context.Pipe()
        self._process = context.Process(target=_run, args=(job, theirs), name="wrenchflow-viewer", daemon=True)
        self._process.start()
        theirs.close()

    def __enter__(self) -> "SceneViewer":
        """Wait until it is open, or say why there is none."""
        said = "it did not open in time"
        if self._control.poll(_START_S):
            try:
                said = self._control.recv()
            except (EOFError, OSError):
                said = "its process died"
        if said:
            logging.getLogger("wrenchflow").warning("going on without a viewer: %s", said)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        with suppress(OSError):  # It has been closed already.
            self._control.send("finish")
        self._process.join(_FINISH_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        self._control.close()
        self._ring.close()
        self._ring.unlink()

    @property
    def is_there(self) -> bool:
        """Whether there is a window still."""
        return self._process.is_alive()

    def tick(self, tick: int, looks: Looks) -> None:
        """A tick is over; most are not shown."""
        if tick % EVERY_TICKS == 0:
            looks.into(self._row[0]["looks"])
            self._ring.push(self._row)


def _row(size: int) -> np.dtype:
    return np.dtype([("looks", "f8", (size,))])


def _run(job: _Job, control: Connection) -> None:
    leave_signals_to_parent()
    os.nice(_NICENESS)
    parent = multiprocessing.parent_process()
    assert parent is not None
    from wrenchflow.sim.window import Window  # Here, so that the control process has none of its threads.

    try:
        window = Window(job.model)
    except WrenchflowError as error:
        control.send(str(error))
        return
    ring = Ring.attach(job.ring, _row(job.size), _ROWS_WAITING)
    try:
        control.send("")
        while window.is_open and not wait([control, parent.sentinel], _POLL_S):
            rows = ring.take()
            if len(rows):
                window.show(rows[-1]["looks"])
    finally:
        window.close()
        ring.close()
        if not parent.is_alive():
            ring.unlink()
