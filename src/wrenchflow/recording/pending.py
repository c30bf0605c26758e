"""The chunk that is being filled: message records in one buffer, and where each of them lies."""

import numpy as np
from jaxtyping import Int64, UInt8, UInt64

from wrenchflow.clock import SECOND_NS

# A chunk is what is lost if the process dies, and what a reader has to decompress to see one message.
CHUNK_NS = SECOND_NS // 2
CHUNK_BYTES = 2 * 1024 * 1024


class PendingChunk:
    """The messages of the next chunk, in a buffer that is used again for the chunk after."""

    def __init__(self) -> None:
        self._buffer = np.empty(CHUNK_BYTES, np.uint8)
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.size = 0
        self.start_ns: int | None = None
        self._index: dict[int, list[np.ndarray]] = {}

    def reserve(self, channel: int, t: Int64[np.ndarray, " n"], size: int) -> UInt8[np.ndarray, "n size"]:
        """Make room for records of one channel, which the caller fills in.

        Args:
            channel: Its id.
            t: Log time of each record [ns]. Shape (n,).
            size: Length of one record in bytes.
        """
        index = np.empty((len(t), 2), np.uint64)
        index[:, 0] = t
        index[:, 1] = np.arange(self.size, self.size + len(t) * size, size)
        self._index.setdefault(channel, []).append(index)
        stop = self.size + len(t) * size
        if stop > len(self._buffer):
            self._buffer = np.concatenate((self._buffer, np.empty(stop, np.uint8)))
        records = self._buffer[self.size : stop].reshape(-1, size)
        self.size = stop
        self.start_ns = int(t[0]) if self.start_ns is None else min(self.start_ns, int(t[0]))
        return records

    @property
    def records(self) -> UInt8[np.ndarray, " size"]:
        """All records."""
        return self._buffer[: self.size]

    @property
    def index(self) -> dict[int, UInt64[np.ndarray, "n 2"]]:
        """Log time and offset of every message, by channel."""
        return {channel: np.concatenate(parts) for channel, parts in self._index.items()}
