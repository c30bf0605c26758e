"""Somebody demonstrates by the clock, one attempt after the other: keep it, do it again, stop, or mend the device."""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from wrenchflow.collect import realtime
from wrenchflow.collect.board.board import Board
from wrenchflow.collect.board.tally import told
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.demonstration import Demonstration
from wrenchflow.collect.desk import Desk
from wrenchflow.collect.devices.device import TeleopDevice
from wrenchflow.collect.devices_table import DEVICES, open_device
from wrenchflow.collect.keys import Keys
from wrenchflow.collect.resume import set_aside
from wrenchflow.collect.viewer import SceneViewer, can_be_seen
from wrenchflow.collect.wishes import KEEP, REDO, STOP, Wishes
from wrenchflow.control.emergency_stop import EmergencyStop
from wrenchflow.errors import DeviceError
from wrenchflow.sim.state import looks_size, model_bytes
from wrenchflow.sim.tasks import scenery

BRAKED = "stopped: emergency-stop"  # What an attempt fails by that an emergency stop ended.
_CHOICE = "right: keep   left: discard and redo   escape: keep and stop"
_MEND = "put it right, then right: go on   left: discard and redo   escape: stop"


class Sitting:
    """One session, from `with` to its end: the terminal's keys, the device and the window are held meanwhile.

    Attributes:
        is_last: Whether somebody wants no more.
    """

    def __init__(
        self, config: CollectConfig, board: Board, *, review: bool, viewer: bool, device: TeleopDevice | None = None
    ) -> None:
        """Say what is wanted.

        Args:
            config: Task, operator, device and gains.
            board: Where it is shown how far all is.
            review: Ask what shall become of each attempt.
            viewer: Open a window on the scene, where there is a display.
            device: What is held, in place of what `config` names.
        """
        self._config, self._review, self._wants_viewer, self._given = config, review, viewer, device
        self._keys = Keys(releases=config.operator == "keyboard")
        self._wishes = Wishes(self._keys)
        self._desk = Desk(board=board, wishes=self._wishes)
        self._board, self._stack = board, ExitStack()

    def __enter__(self) -> "Sitting":
        """Open what is needed.

        Raises:
            DeviceError: If the device is not there.
        """
        with ExitStack() as stack:
            stack.enter_context(self._keys)
            self._stack = stack
            device = self._open() if self._given is None else self._given
            stack.callback(self._close)
            self._desk = replace(self._desk, device=device, viewer=self._window(stack))
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Let go of all of it."""
        self._stack.close()

    @property
    def is_last(self) -> bool:
        """Whether somebody wants no more."""
        return self._wishes.is_last

    def run(self, indices: Sequence[int], folder: Path, stop: EmergencyStop, there: int) -> Iterator[Demonstration]:
        """Demonstrate, and yield what is kept.

        Args:
            indices: Numbers of the episodes.
            folder: Where recordings go.
            stop: What brakes the arm from outside.
            there: How many episodes are in the folder already.

        An attempt that an emergency stop ended is set aside, so that its scene is done again by who goes on.

        Raises:
            DeviceError: If a device was lost, and there is nobody who could say how to go on.
            KeyboardInterrupt, Terminated, ControlError: After a stop.
        """
        total = there + len(indices)
        for index in indices:
            while True:
                shown = realtime.demonstrate_in_real_time(index, self._config, folder, stop, self._desk)
                verdict = self._verdict(shown, stop)
                if verdict != REDO and shown.outcome.failure != BRAKED:
                    break
                set_aside(folder / f"{shown.id}.mcap")
                self._board.discard(shown)
                stop.require_none(f"{there} of {total} episodes are in '{folder}'.")
                if self.is_last:
                    return
            there += 1
            yield shown
            stop.require_none(f"{there} of {total} episodes are in '{folder}'.")
            if shown.outcome.failure.startswith(realtime.LOST) and not self._wishes.can_ask:
                lost = DeviceError(shown.outcome.failure)
                lost.add_note(f"{there} of {total} episodes are in '{folder}': --resume goes on with them.")
                raise lost
            if self.is_last:
                return
            self._again()

    def _verdict(self, shown: Demonstration, stop: EmergencyStop) -> str:
        """What becomes of an attempt; nobody is asked about it after a stop."""
        if stop.heard is not None or not self._wishes.can_ask:
            return KEEP
        if shown.outcome.failure.startswith(realtime.LOST):
            return self._mend(shown, stop)
        if not self._review or self._wishes.ending:
            return self._wishes.ending or KEEP
        return self._ask(f"{told(shown)}\n{_CHOICE}", stop)

    def _mend(self, shown: Demonstration, stop: EmergencyStop) -> str:
        """Wait until the device is there again, or nobody wants to go on."""
        question = f"{shown.outcome.failure}\n{_MEND}"
        while (verdict := self._ask(question, stop)) != STOP:
            try:
                self._reopen()
                return verdict
            except DeviceError as error:
                question = f"{error}\n{_MEND}"
        return verdict

    def _ask(self, question: str, stop: EmergencyStop) -> str:
        self._board.ask(question)
        verdict = self._wishes.ask(lambda: stop.heard is not None)
        self._board.ask("")
        if verdict == STOP:
            self._wishes.is_last = True
        return verdict

    def _again(self) -> None:
        """A recording that was played once is played from its beginning."""
        if self._config.operator == "replay":
            self._reopen()

    def _open(self) -> TeleopDevice | None:
        return open_device(self._config, self._keys) if self._config.operator in DEVICES else None

    def _reopen(self) -> None:
        if self._given is None:
            self._close()
            self._desk = replace(self._desk, device=self._open())

    def _close(self) -> None:
        if self._desk.device is not None:
            self._desk.device.close()

    def _window(self, stack: ExitStack) -> SceneViewer | None:
        if not self._wants_viewer:
            return None
        if not can_be_seen():
            self._board.say("there is no display: going on without a viewer (--no-viewer says nothing of it).")
            return None
        _, _, model = scenery(self._config.task, self._config.rig)
        return stack.enter_context(SceneViewer(model_bytes(model), looks_size(model)))
