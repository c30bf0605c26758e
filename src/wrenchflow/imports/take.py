"""What one episode is made from: a table, a struct of arrays, or the topics of a file."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.imports.mapping import Clock, Values
from wrenchflow.signals import Signal


@dataclass(frozen=True, kw_only=True, eq=False)
class TopicRows:
    """The messages of a topic, in the order of the file.

    Attributes:
        header_ns: Stamps in their headers [ns]; None if they have no header, or nobody filled it in. Shape (n,).
        log_ns: When the file says that they were sent, or received [ns]. Shape (n,).
        data: One row a message, in the units of the message. Shape (n, d).
        signal: What they measure.
        frame: As the header says.
    """

    header_ns: Int64[np.ndarray, " n"] | None
    log_ns: Int64[np.ndarray, " n"]
    data: Float[np.ndarray, "n d"]
    signal: Signal
    frame: str


@runtime_checkable
class Take(Protocol):
    """One episode of a foreign file."""

    @property
    def id(self) -> str:
        """Name of the episode."""
        ...

    def numbers(self, part: Values, width: int | None, where: str) -> Float[np.ndarray, "n k"]:
        """The numbers of a part of a stream, one sample a row.

        Args:
            part: Which.
            width: How many channels it has to have; None for any number.
            where: Name of the part, for messages.

        Raises:
            RecordingError: If they are not there, or no numbers.
        """
        ...

    def stamps(self, clock: Clock, where: str) -> Int64[np.ndarray, " n"]:
        """The stamps of a clock that has some [ns].

        Raises:
            RecordingError: If they are not there, or no numbers.
        """
        ...

    def topic(self, name: str, where: str) -> TopicRows:
        """The messages of a topic.

        Raises:
            RecordingError: If there is no such topic, or its type is none that is known here.
        """
        ...
