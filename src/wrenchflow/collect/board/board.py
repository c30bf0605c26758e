"""Where a session shows how far it is: on lines, on a screen, or on one that another process draws."""

import sys
from types import TracebackType
from typing import Protocol, runtime_checkable

from wrenchflow.collect.board.row import Feed
from wrenchflow.collect.board.tally import Tally, told
from wrenchflow.collect.demonstration import Demonstration


@runtime_checkable
class Board(Protocol):
    """What a session tells. None of it waits for anybody who looks."""

    def __enter__(self) -> "Board":
        """Begin to show."""
        ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def begin(self, id: str) -> Feed | None:
        """An attempt begins; what its control loop tells goes into the feed, where there is one."""
        ...

    def add(self, shown: Demonstration) -> None:
        """An episode is kept."""
        ...

    def discard(self, shown: Demonstration) -> None:
        """An episode is not kept."""
        ...

    def say(self, text: str) -> None:
        """Something that a person should read."""
        ...

    def ask(self, question: str) -> None:
        """What is waited for; empty when it came."""
        ...


class Nowhere:
    """Nobody looks."""

    def __enter__(self) -> "Nowhere":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """There is nothing to put back."""

    def begin(self, id: str) -> Feed | None:
        """Nobody looks while it happens."""
        return None

    def add(self, shown: Demonstration) -> None:
        """It is not told."""

    def discard(self, shown: Demonstration) -> None:
        """It is not told."""

    def say(self, text: str) -> None:
        """It is not told."""

    def ask(self, question: str) -> None:
        """It is not told."""


class Lines(Nowhere):
    """A line an episode, for a file or for whoever does not look."""

    def __init__(self, tally: Tally) -> None:
        """Begin."""
        self._tally = tally

    def add(self, shown: Demonstration) -> None:
        """Its line."""
        self._tally = self._tally.with_(shown)
        if not shown.was_there:
            self.say(f"{self._tally.kept} of {self._tally.total}  {told(shown)}")

    def discard(self, shown: Demonstration) -> None:
        """Its line."""
        self._tally = self._tally.without(shown)
        self.say(f"discarded  {told(shown)}")

    def say(self, text: str) -> None:
        """A line."""
        sys.stderr.write(f"{text}\n")
        sys.stderr.flush()

    def ask(self, question: str) -> None:
        """A line, once."""
        if question:
            self.say(question)
