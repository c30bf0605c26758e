"""From the messages of one channel to the samples of a stream: all at once where they look alike, else one by one."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import UInt8, UInt64
from mcap.opcode import Opcode

from wrenchflow.errors import RecordingError
from wrenchflow.recording import codec, schemas
from wrenchflow.recording.layout import HEADER, SECOND_NS, UNCOUNTED, Layout, Samples
from wrenchflow.signals import Signal

_STAMP = ("header.stamp.sec", "header.stamp.nanosec")


@dataclass
class Topic:
    """One channel while it is read.

    Attributes:
        channel: Its id.
        message: Full name of its message type.
        signal: What it measures, where the file says so; else it is inferred from the first message.
        frame: Its frame, where the file says so; else that of the first message.
        samples: What was read so far, a part a chunk.
    """

    channel: int
    message: str
    signal: Signal | None = None
    frame: str | None = None
    samples: list[Samples] = field(default_factory=list)
    _layout: Layout | None = None
    _constants: dict[str, object] = field(default_factory=dict)

    def read(self, data: UInt8[np.ndarray, " size"], index: UInt64[np.ndarray, "n 2"]) -> None:
        """Read the channel's messages of one chunk.

        Args:
            data: The uncompressed chunk.
            index: Log time [ns] and offset of each message. Shape (n, 2).

        Raises:
            RecordingError: If the index does not lead to messages of this channel, or if they change what they measure.
        """
        offsets = index[:, 1].astype(np.int64)
        if self._layout is None and not self._begin(record_at(data, int(offsets[0]), self.channel)):
            return
        assert self._layout is not None
        records = gather(data, offsets, self._layout.size)
        if records is not None and self._layout.matches(records):
            self.samples.append(self._layout.decode(records))
        else:
            rows = [self._read_one(record_at(data, int(offset), self.channel)) for offset in offsets]
            self.samples.append(Samples(*(np.concatenate(parts) for parts in zip(*rows, strict=True))))

    def _begin(self, record: bytes) -> bool:
        """Learn from the first message; False if nothing says what it measures."""
        leaves = codec.decode(self.message, record[HEADER.itemsize :])
        if self.signal is None:
            label = leaves.get("layout.dim[0].label")
            self.signal = schemas.infer_signal(self.message, leaves, str(label.value) if label else "")
            if self.signal is None:
                return False
        if self.frame is None:
            frame = leaves.get("header.frame_id")
            self.frame = str(frame.value) if frame else ""
        self._layout = Layout.of_record(self.signal, record)
        self._constants = self._constants_of(leaves)
        return True

    def _constants_of(self, leaves: dict[str, codec.Leaf]) -> dict[str, object]:
        assert self.signal is not None
        varying = {*_STAMP, *schemas.column_paths(self.signal)}
        return {path: leaf.value for path, leaf in leaves.items() if path not in varying}

    def _read_one(self, record: bytes) -> Samples:
        assert self.signal is not None
        leaves = codec.decode(self.message, record[HEADER.itemsize :])
        constants = self._constants_of(leaves)
        if constants != self._constants:
            path = min(p for p in {*constants, *self._constants} if constants.get(p) != self._constants.get(p))
            raise RecordingError(
                f"its messages disagree on '{path}', which is {self._constants.get(path)!r} first and "
                f"{constants.get(path)!r} later; a stream has one frame and one set of columns."
            )
        publish = int(np.frombuffer(record, HEADER, 1)["publish_time"][0])
        seconds, nanoseconds = (leaves.get(path) for path in _STAMP)
        stamp = seconds.value * SECOND_NS + nanoseconds.value if seconds and nanoseconds else publish
        paths = schemas.column_paths(self.signal)
        row = [leaves[path].value if path in leaves else np.nan for path in paths]
        return Samples(np.array([stamp]), np.array([publish]), np.array([row], float))


def record_at(data: UInt8[np.ndarray, " size"], offset: int, channel: int) -> bytes:
    """The message record at a place of a chunk, with its header.

    Raises:
        RecordingError: If there is no message of that channel.
    """
    start = offset + HEADER.itemsize
    if offset >= 0 and start <= len(data):
        header = np.frombuffer(data[offset:start], HEADER)[0]
        stop = offset + UNCOUNTED + int(header["length"])
        if header["opcode"] == Opcode.MESSAGE and header["channel"] == channel and start <= stop <= len(data):
            return data[offset:stop].tobytes()
    raise RecordingError(f"its index leads to byte {offset} of a chunk, where no message of channel {channel} is.")


def gather(data: UInt8[np.ndarray, " size"], offsets: np.ndarray, size: int) -> UInt8[np.ndarray, "n record"] | None:
    """The bytes of many records of one size, or None where they cannot all have it.

    Args:
        data: The uncompressed chunk.
        offsets: Where each record starts. Shape (n,).
        size: Length of each record in bytes.
    """
    first, last = int(offsets[0]), int(offsets[-1])
    if offsets.min() < 0 or offsets.max() + size > len(data):
        return None
    if last - first == (len(offsets) - 1) * size and (np.diff(offsets) == size).all():
        return data[first : last + size].reshape(-1, size)
    # Windows of `size` bytes that start at every byte: a void item is copied in one piece.
    windows = np.ndarray((len(data) - size + 1,), np.dtype((np.void, size)), data, strides=(1,))
    return windows[offsets].view(np.uint8).reshape(-1, size)
