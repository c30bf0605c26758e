"""The bytes of messages that stay in their file until somebody asks for them."""

from collections.abc import Sequence
from typing import overload

import numpy as np
from jaxtyping import Int64

from wrenchflow.recording.container import Container


class Payloads(Sequence[memoryview]):
    """Messages of a file, as they are on the wire; what is sliced from it reads from the file too.

    A chunk that is compressed is decompressed when one of its messages is asked for, and the file keeps the last one.
    From one that is not, a message is handed out without a copy. A message that is held keeps its chunk in memory.
    """

    def __init__(
        self,
        container: Container,
        chunks: Int64[np.ndarray, " n"],
        starts: Int64[np.ndarray, " n"],
        lengths: Int64[np.ndarray, " n"],
    ) -> None:
        """Note where the messages lie.

        Args:
            container: The file.
            chunks: Number of each message's chunk. Shape (n,).
            starts: Its first byte in the uncompressed chunk. Shape (n,).
            lengths: How many bytes it has. Shape (n,).
        """
        self._container = container
        self._places = chunks, starts, lengths

    def __len__(self) -> int:
        return len(self._places[0])

    @overload
    def __getitem__(self, which: int) -> memoryview: ...

    @overload
    def __getitem__(self, which: slice) -> "Payloads": ...

    def __getitem__(self, which: int | slice) -> "memoryview | Payloads":
        """One message, or some, by a slice.

        Raises:
            RecordingError: If the chunk of the message is damaged.
        """
        chunk, start, length = (place[which] for place in self._places)
        if isinstance(which, slice):
            return Payloads(self._container, chunk, start, length)
        data = self._container.unpack(self._container.chunks[chunk])
        return data[start : start + length].data
