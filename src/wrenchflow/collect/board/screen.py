"""A board on the terminal of this process, for what is recorded as fast as it goes: drawn once an episode."""

import sys
import time
from types import TracebackType

from rich.console import Console, RenderableType
from rich.live import Live
from rich.text import Text

from wrenchflow.collect.board.look import Facts, look
from wrenchflow.collect.board.row import Feed
from wrenchflow.collect.board.tally import Tally, told
from wrenchflow.collect.demonstration import Demonstration


class Screen:
    """Episodes, at what rate time goes by in them, who succeeds, and what is covered."""

    def __init__(self, facts: Facts, tally: Tally) -> None:
        """Take what is known before it begins."""
        self._facts, self._tally = facts, tally
        # Drawn when something happens, by nobody else: a thread that draws would draw into a traceback.
        self._live = Live(console=Console(file=sys.stderr), auto_refresh=False, transient=True, redirect_stdout=False)
        self._start_s = time.monotonic()

    def __enter__(self) -> "Screen":
        """Begin to draw."""
        self._live.start()
        self._draw()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the terminal as it was, whatever happened."""
        self._live.stop()

    def begin(self, id: str) -> Feed | None:
        """Nobody can look into an episode that is made as fast as it goes."""
        return None

    def add(self, shown: Demonstration) -> None:
        """One more."""
        self._tally = self._tally.with_(shown)
        for why in shown.refused:
            self.say(f"{shown.id}: tare refused: {why}")
        self._draw()

    def discard(self, shown: Demonstration) -> None:
        """One less."""
        self._tally = self._tally.without(shown)
        self.say(f"discarded  {told(shown)}")

    def say(self, text: str) -> None:
        """A line above the board."""
        self._live.console.print(Text(text))
        self._draw()

    def ask(self, question: str) -> None:
        """Nothing: nobody is asked while nobody demonstrates."""

    def _draw(self) -> None:
        self._live.update(self._picture(), refresh=True)

    def _picture(self) -> RenderableType:
        rate = self._tally.simulated_s / max(time.monotonic() - self._start_s, 1e-3)
        return look(self._facts, self._tally, id=f"{rate:.1f} s simulated a second")
