"""What a recording holds besides streams: messages that are kept as they are, and attached files."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import overload

import numpy as np
from jaxtyping import Int64

from wrenchflow.errors import StreamError

Bytes = bytes | memoryview


@dataclass(frozen=True, kw_only=True)
class MessageType:
    """How the messages of a topic are to be understood.

    Attributes:
        name: Such as `sensor_msgs/msg/CompressedImage`.
        definition: The schema's bytes.
        schema_encoding: Of the definition, such as `ros2msg`; empty for messages without a schema.
        encoding: Of the messages, such as `cdr`.
    """

    name: str
    definition: bytes
    schema_encoding: str
    encoding: str


@dataclass(frozen=True, eq=False)
class Messages:
    """The messages of a topic that is no stream: images, or what another writer recorded.

    Attributes:
        type: How they are to be understood.
        t: When each was sampled or published [ns]. Shape (n,).
        received: When each was had [ns]. Shape (n,).
        sequence: Number of each at its source. Shape (n,).
        payloads: The bytes of each; may be read from a file at the moment when they are asked for.
    """

    type: MessageType
    t: Int64[np.ndarray, " n"]
    received: Int64[np.ndarray, " n"]
    sequence: Int64[np.ndarray, " n"]
    payloads: Sequence[Bytes]

    def __post_init__(self) -> None:
        lengths = {len(self.t), len(self.received), len(self.sequence), len(self.payloads)}
        if len(lengths) != 1:
            raise StreamError(f"messages take one stamp, receive time, number and payload each, got {sorted(lengths)}.")

    def __len__(self) -> int:
        return len(self.t)

    def __eq__(self, other: object) -> bool:
        """Equal when every stamp, every number and every byte is."""
        return (
            isinstance(other, Messages)
            and self.type == other.type
            and all(np.array_equal(getattr(self, name), getattr(other, name)) for name in ("t", "received", "sequence"))
            and all(bytes(a) == bytes(b) for a, b in zip(self.payloads, other.payloads, strict=True))
        )

    def __reduce__(self):  # Payloads may lie in a mapped file, which does not travel between processes.
        payloads = tuple(bytes(payload) for payload in self.payloads)
        return Messages, (self.type, self.t, self.received, self.sequence, payloads)

    def part(self, of: slice) -> "Messages":
        """Some of the messages, in their order."""
        t, received, sequence = self.t[of], self.received[of], self.sequence[of]
        return replace(self, t=t, received=received, sequence=sequence, payloads=self.payloads[of])

    def between(self, start_ns: int, stop_ns: int) -> "Messages":
        """The messages with start_ns <= t < stop_ns, in their order."""
        kept = np.flatnonzero((self.t >= start_ns) & (self.t < stop_ns))
        if not len(kept) or kept[-1] - kept[0] == len(kept) - 1:
            return self.part(slice(int(kept[0]), int(kept[-1]) + 1) if len(kept) else slice(0))
        t, received, sequence = self.t[kept], self.received[kept], self.sequence[kept]
        return replace(self, t=t, received=received, sequence=sequence, payloads=_Some(self.payloads, kept))


class _Some(Sequence[Bytes]):
    """Some of the payloads, which are read no sooner than those."""

    def __init__(self, payloads: Sequence[Bytes], which: Int64[np.ndarray, " n"]) -> None:
        self._payloads, self._which = payloads, which

    def __len__(self) -> int:
        return len(self._which)

    @overload
    def __getitem__(self, which: int) -> Bytes: ...

    @overload
    def __getitem__(self, which: slice) -> "_Some": ...

    def __getitem__(self, which: int | slice) -> "Bytes | _Some":
        if isinstance(which, slice):
            return _Some(self._payloads, self._which[which])
        return self._payloads[int(self._which[which])]


@dataclass(frozen=True, kw_only=True)
class Attachment:
    """A file within a recording.

    Attributes:
        data: Its bytes.
        media_type: Such as `application/json`.
        log_time_ns: When it was recorded [ns].
        create_time_ns: When it was made [ns]; 0 where that is not known.
    """

    data: bytes
    media_type: str
    log_time_ns: int = 0
    create_time_ns: int = 0
