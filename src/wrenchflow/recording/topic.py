"""From the messages of one channel to the samples of a stream: all at once where they look alike, else one by one."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int64, UInt8, UInt64
from mcap.opcode import Opcode

from wrenchflow.errors import RecordingError
from wrenchflow.recording import codec, schemas
from wrenchflow.recording.container import Container
from wrenchflow.recording.layout import HEADER, SECOND_NS, UNCOUNTED, Layout
from wrenchflow.signals import Signal

# Of one message that is looked into; what is larger is an image, or an enemy.
_MOST_BYTES = 2**20
_FREE_BYTES, _MOST_EXPANSION = 128 * 2**20, 64
_STAMP = ("header.stamp.sec", "header.stamp.nanosec")


class Samples:
    """What the messages of a topic say, in their order, while it is gathered.

    Attributes:
        stamp: Time in the message's header [ns], or `publish` where it has none. Shape (n,).
        publish: Time in the record [ns]. Shape (n,).
        data: Rows of the signal. Shape (n, d).
    """

    def __init__(self, count: int, width: int) -> None:
        """Room for `count` rows of `width` columns."""
        self.stamp: Int64[np.ndarray, " n"] = np.empty(count, np.int64)
        self.publish: Int64[np.ndarray, " n"] = np.empty(count, np.int64)
        self.data: Float[np.ndarray, "n d"] = np.empty((count, width))
        self.filled = 0


@dataclass
class Topic:
    """How the messages of one channel are read.

    Attributes:
        channel: Its id.
        message: Full name of its message type.
        signal: What it measures, where the file says so; else it is inferred from the first message.
        frame: Its frame, where the file says so; else that of the first message.
    """

    channel: int
    message: str
    signal: Signal | None = None
    frame: str | None = None
    _layout: Layout | None = None
    _constants: dict[str, object] = field(default_factory=dict)

    def begin(self, record: bytes) -> bool:
        """Learn from the first message; False if nothing says what it measures.

        Raises:
            RecordingError: If it is no such message.
        """
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

    def read(self, data: UInt8[np.ndarray, " size"], index: UInt64[np.ndarray, "n 2"], samples: Samples) -> None:
        """Read the channel's messages of one chunk.

        Args:
            data: The uncompressed chunk.
            index: Log time [ns] and offset of each message. Shape (n, 2).
            samples: Where they go, behind those that are there.

        Raises:
            RecordingError: If the index does not lead to messages of this channel, or if they change what they measure.
        """
        from wrenchflow.recording.records import take_samples, words_of

        offsets = index[:, 1].astype(np.uint64)
        if self._layout is None:
            self.begin(record_at(data, int(offsets[0]), self.channel))
        assert self._layout is not None
        of, size = self._layout.parts, np.uint64(self._layout.size)
        words, first, done = words_of(data), samples.filled, 0
        samples.filled += len(offsets)
        stamp, publish, rows = (part[first : samples.filled] for part in (samples.stamp, samples.publish, samples.data))
        if not of.are_all_held:
            rows.fill(np.nan)
        while done < len(offsets):
            done += take_samples(
                data,
                words,
                offsets[done:],
                size,
                of.constant,
                of.runs,
                of.stamp,
                stamp[done:],
                publish[done:],
                rows[done:],
            )
            if done < len(offsets):
                record = record_at(data, int(offsets[done]), self.channel)
                stamp[done], publish[done], rows[done] = self._read_one(record)
                done += 1

    def _constants_of(self, leaves: dict[str, codec.Leaf]) -> dict[str, object]:
        assert self.signal is not None
        varying = {*_STAMP, *schemas.column_paths(self.signal)}
        return {path: leaf.value for path, leaf in leaves.items() if path not in varying}

    def _read_one(self, record: bytes) -> tuple[int, np.int64, list[float]]:
        """Stamp, publish time and values of a message that does not look like the first."""
        assert self.signal is not None
        leaves = codec.decode(self.message, record[HEADER.itemsize :])
        constants = self._constants_of(leaves)
        if constants != self._constants:
            path = min(p for p in {*constants, *self._constants} if constants.get(p) != self._constants.get(p))
            raise RecordingError(
                f"its messages disagree on '{path}', which is {self._constants.get(path)!r} first and "
                f"{constants.get(path)!r} later; a stream has one frame and one set of columns."
            )
        publish = np.frombuffer(record, HEADER, 1)["publish_time"].astype(np.int64)[0]
        seconds, nanoseconds = (leaves.get(path) for path in _STAMP)
        stamp = seconds.value * SECOND_NS + nanoseconds.value if seconds and nanoseconds else publish
        paths = schemas.column_paths(self.signal)
        return stamp, publish, [leaves[path].value if path in leaves else np.nan for path in paths]


def check_room(values: int, container: Container) -> None:
    """Refuse samples that take far more memory than their file is large.

    A message takes sixteen bytes in the index and a dozen for its times, however little else there is in it. So even
    of a robot at rest the samples take ten times as much as the file; what takes more than this was made to.

    Raises:
        RecordingError: If there are too many.
    """
    size = 8 * values
    if size > max(_FREE_BYTES, _MOST_EXPANSION * container.size):
        raise RecordingError(
            f"the samples of {container.path} take {size} bytes, and the file {container.size}. Read it in parts."
        )


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
            if stop - start > _MOST_BYTES:
                raise RecordingError(f"a message has {stop - start} bytes, where {_MOST_BYTES} are the most.")
            return data[offset:stop].tobytes()
    raise no_message(offset, channel)


def no_message(offset: int, channel: int) -> RecordingError:
    """The error that says that an index is wrong."""
    return RecordingError(f"its index leads to byte {offset} of a chunk, where no message of channel {channel} is.")
