"""A board that another process draws while somebody demonstrates: whoever runs the control loop has no time to."""

import logging
import multiprocessing
import sys
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Any

from wrenchflow.collect.board.look import Facts
from wrenchflow.collect.board.row import ROW, ROWS_WAITING, Feed
from wrenchflow.collect.board.tally import Tally
from wrenchflow.collect.demonstration import Demonstration
from wrenchflow.recording.ring import Ring

_FINISH_S = 5.0
_SHOW_CURSOR = "\x1b[?25h"


@dataclass(frozen=True, kw_only=True)
class Job:
    """What the process is told at the start.

    Attributes:
        facts: Of the session.
        tally: How far it is.
        ring: Name of the ring that rows come through.
        has_sound: Whether a force that rises is heard.
    """

    facts: Facts
    tally: Tally
    ring: str
    has_sound: bool


class LiveBoard:
    """A `Board` in a process of its own, less urgent than the loop; if it dies, nothing else happens.

    Warnings go to it as long as it is there, for two who write to one terminal at once leave neither readable.
    """

    def __init__(self, facts: Facts, tally: Tally, *, has_sound: bool) -> None:
        """Say what to draw; it begins with `with`."""
        self._ring = Ring.create(ROW, ROWS_WAITING)
        job = Job(facts=facts, tally=tally, ring=self._ring.name, has_sound=has_sound)
        context = multiprocessing.get_context("spawn")
        self._control, theirs = context.Pipe()
        self._theirs: Connection | None = theirs
        self._process = context.Process(target=_run, args=(job, theirs), name="wrenchflow-board", daemon=True)
        self._handler = _ToBoard(self)

    def __enter__(self) -> "LiveBoard":
        """Start to draw."""
        try:
            self._process.start()
        except BaseException:
            self._ring.close()
            self._ring.unlink()
            raise
        assert self._theirs is not None
        self._theirs.close()
        self._theirs = None
        logging.getLogger("wrenchflow").addHandler(self._handler)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let it finish, and leave the terminal as it was, whatever happened to it."""
        logging.getLogger("wrenchflow").removeHandler(self._handler)
        self._tell("finish")
        self._process.join(_FINISH_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()
        if self._process.exitcode:
            sys.stderr.write(_SHOW_CURSOR)
            sys.stderr.flush()
        self._control.close()
        self._ring.close()
        self._ring.unlink()

    @property
    def pid(self) -> int:
        """Number of the process that draws."""
        assert self._process.pid is not None
        return self._process.pid

    def begin(self, id: str) -> Feed | None:
        """An attempt begins."""
        self._tell("begin", id)
        return Feed(self._ring)

    def add(self, shown: Demonstration) -> None:
        """An episode is kept."""
        self._tell("add", shown)

    def discard(self, shown: Demonstration) -> None:
        """An episode is not kept."""
        self._tell("discard", shown)

    def say(self, text: str) -> None:
        """A line above the board."""
        self._tell("say", text)

    def ask(self, question: str) -> None:
        """A line in it."""
        self._tell("ask", question)

    def _tell(self, what: str, value: Any = None) -> None:
        with suppress(OSError):  # It has died, and nobody minds.
            self._control.send((what, value))


class _ToBoard(logging.Handler):
    def __init__(self, board: LiveBoard) -> None:
        super().__init__()
        self._board = board

    def emit(self, record: logging.LogRecord) -> None:
        self._board.say(record.getMessage())


def _run(job: Job, control: Connection) -> None:
    from wrenchflow.collect.board.board_process import run_board

    run_board(job, control)
