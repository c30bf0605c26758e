"""Emergency stop by signal: whoever may send one to the process that runs the loop stops the arm, in any mode."""

import signal
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any

from wrenchflow.errors import ControlError, Terminated

# What a stop button's program sends, as `kill -USR1 PID` does; Windows has none.
STOP_SIGNAL: signal.Signals | None = getattr(signal, "SIGUSR1", None)
_HEARD = tuple(each for each in (STOP_SIGNAL, signal.SIGTERM, signal.SIGINT) if each is not None)


class EmergencyStop:
    """While entered, SIGUSR1, SIGTERM and Ctrl-C do not end the process: they brake the arm, and latch.

    The loop goes on, for somebody has to brake; once the arm rests and what was recorded is written, `require_none`
    ends the run. A second SIGTERM or Ctrl-C is answered as it was before; a stop button that bounces changes nothing.
    """

    def __init__(self) -> None:
        self.heard: signal.Signals | None = None
        self._stop: Callable[[], None] = _nobody
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> "EmergencyStop":
        for number in _HEARD:
            self._before[number] = signal.signal(number, self._hear)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._stop = _nobody

    def stops(self, stop: Callable[[], None]) -> None:
        """Say what is to be called, such as `Controller.stop` of an arm that begins; at once if a stop was heard."""
        self._stop = stop
        if self.heard is not None:
            stop()

    def require_none(self, done: str) -> None:
        """Go on only if no stop was heard.

        Args:
            done: A sentence that says what there is already; it goes along with the error.

        Raises:
            KeyboardInterrupt: After Ctrl-C.
            Terminated: After SIGTERM.
            ControlError: After SIGUSR1.
        """
        if self.heard is None:
            return
        endings = {signal.SIGINT: KeyboardInterrupt(), signal.SIGTERM: Terminated()}
        end = endings.get(self.heard, ControlError(f"emergency stop by {self.heard.name}: the arm was braked."))
        end.add_note(done)
        raise end

    def _hear(self, number: int, frame: FrameType | None) -> None:
        again, self.heard = self.heard is not None, self.heard or signal.Signals(number)
        self._stop()
        if again and number != STOP_SIGNAL:
            before = self._before[signal.Signals(number)]
            if callable(before):
                before(number, frame)


def _nobody() -> None:
    """There is no arm to stop yet, or no more."""
