"""An MCAP file while it is written: chunks by time, whole columns at once, and equal bytes for equal data."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from jaxtyping import Float, Int64
from mcap.records import Channel, Schema

from wrenchflow.clock import SECOND_NS
from wrenchflow.episode import Event, Stream
from wrenchflow.errors import StreamError, unknown
from wrenchflow.messages import Attachment, Messages, MessageType
from wrenchflow.recording import codec, schemas
from wrenchflow.recording.file_format import EVENTS, FORMAT_VERSION, META_PREFIX, METADATA, RESULT
from wrenchflow.recording.layout import Layout, record_header
from wrenchflow.recording.pending import CHUNK_BYTES, CHUNK_NS, PendingChunk
from wrenchflow.recording.sink import Sink
from wrenchflow.signals import Signal

# `header.stamp` holds int32 seconds.
_LAST_NS = 2**31 * SECOND_NS - 1
_EVENTS_CHANNEL = 1


# These are compressed already, so they get chunks of their own, which are not, and which no reader of streams opens.
_COMPRESSED_ALREADY = (schemas.IMAGE_MESSAGE,)


@dataclass
class _Topic:
    """A stream that is being written: how, and how far."""

    channel: int
    layout: Layout
    frame: str
    count: int = 0
    last_ns: int = -1


@dataclass
class _Other:
    """A topic of messages that are kept as they are."""

    channel: int
    type: MessageType
    count: int = 0


class EpisodeWriter:
    """Writes one episode while it happens.

        with EpisodeWriter(path, id="0007", task="peg-insertion", meta={"seed": 7}) as writer:
            writer.add_stream("tcp_pose", POSE, "base")
            writer.write("tcp_pose", t, rows)
            writer.finish(result={"success": True})

    All streams are added before the first sample is written. The file is called `<path>.partial` until `finish`, or
    until the `with` block ends in the ordinary way; if it ends in an exception, the partial file stays as it is.
    """

    def __init__(
        self,
        path: Path,
        *,
        id: str,
        task: str,
        meta: Mapping[str, Any] | None = None,
        compression: str = "zstd",
        attachments: Mapping[str, Attachment] | None = None,
    ) -> None:
        """Start the file.

        Args:
            path: Where the finished file goes.
            id: Name of the episode.
            task: The task that is attempted.
            meta: JSON values that are known at the start.
            compression: One of `compression.NAMES`.
            attachments: Files that the recording carries, by name.

        Raises:
            ConfigError: If there is no such compression.
            OutputError: If the path is taken or cannot be written.
            StreamError: If `meta` holds what JSON cannot.
        """
        entries = {META_PREFIX + key: _json(key, value) for key, value in (meta or {}).items()}
        self._start = {"format_version": str(FORMAT_VERSION), "id": id, "task": task, **entries}
        self._attachments = dict(attachments or {})
        self._topics: dict[str, _Topic] = {}
        self._others: dict[str, _Other] = {}
        self._n_events = 0
        self._pending, self._pending_images = PendingChunk(), PendingChunk()
        self._started = self._finished = False
        self._sink = Sink(path, compression)

    def __enter__(self) -> "EpisodeWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None and not self._finished:
                self.finish()
        finally:
            self.close()

    def close(self) -> None:
        """Let go of the file; unless it was finished, it stays `.partial`."""
        self._sink.close()

    def add_stream(self, name: str, signal: Signal, frame: str = "") -> None:
        """Declare a stream.

        Args:
            name: Its name: the topic without its leading slash.
            signal: What its columns measure.
            frame: The frame that its values are expressed in.

        Raises:
            StreamError: If the name is taken, writing has begun, or no message can carry the signal.
        """
        channel = self._next_channel(name)
        self._topics[name] = _Topic(channel, Layout.for_stream(signal, frame, channel), frame)

    def add_messages(self, name: str, type: MessageType) -> None:
        """Declare a topic whose messages are kept as they are.

        Args:
            name: Its name: the topic without its leading slash.
            type: How its messages are to be understood.

        Raises:
            StreamError: If the name is taken, or writing has begun.
        """
        self._others[name] = _Other(self._next_channel(name), type)

    def _next_channel(self, name: str) -> int:
        if self._started:
            raise StreamError(f"'{name}' comes too late: all topics are added before the first chunk is written.")
        if name in self._topics or name in self._others or name == EVENTS:
            raise StreamError(f"'{name}' cannot be added: the name is taken.")
        return _EVENTS_CHANNEL + 1 + len(self._topics) + len(self._others)

    def record_size(self, name: str) -> int:
        """Bytes of one sample of a stream."""
        return self._topics[name].layout.size

    def write(
        self,
        name: str,
        t: Int64[np.ndarray, " n"],
        rows: Float[np.ndarray, "n d"],
        *,
        received: Int64[np.ndarray, " n"] | None = None,
        sequence: Int64[np.ndarray, " n"] | None = None,
    ) -> None:
        """Append samples to a stream.

        Args:
            name: A stream that was added.
            t: When each was sampled [ns], later than those already written. Shape (n,).
            rows: The samples, in the columns and units of the signal. Shape (n, d).
            received: When each was had [ns]; without it, when it was sampled. Shape (n,).
            sequence: Number of each at its source, so that a gap can be counted; without it they are counted here.

        Raises:
            StreamError: If the samples break the rules of a `Stream`, or cannot be represented in its message.
        """
        self.check(name, Stream(t, rows, self._topic(name).layout.signal))
        self.append(name, t, rows, received=received, sequence=sequence)

    def check(self, name: str, stream: Stream) -> None:
        """Look whether samples may be appended; who appends in parts looks once.

        Raises:
            StreamError: If they may not.
        """
        topic, t = self._topic(name), stream.t
        if len(t) and not (topic.last_ns < t[0] and t[-1] <= _LAST_NS):
            raise StreamError(
                f"stream '{name}' takes stamps after {topic.last_ns} ns and up to {_LAST_NS}, got {t[0]} to {t[-1]}."
            )
        topic.layout.check(stream.data)

    def append(
        self,
        name: str,
        t: Int64[np.ndarray, " n"],
        rows: Float[np.ndarray, "n d"],
        *,
        received: Int64[np.ndarray, " n"] | None = None,
        sequence: Int64[np.ndarray, " n"] | None = None,
    ) -> None:
        """Append samples that `check` has passed; arguments as of `write`."""
        topic = self._topic(name)
        received = t if received is None else received
        sequence = np.arange(topic.count, topic.count + len(t)) if sequence is None else sequence
        first = 0
        while first < len(t):
            last = self._room(t, first, topic.layout.size)
            if last == first:
                self.flush()
                continue
            part = slice(first, last)
            records = self._pending.reserve(topic.channel, received[part], topic.layout.size)
            topic.layout.encode(t[part], rows[part], sequence=sequence[part], received=received[part], out=records)
            topic.count += last - first
            topic.last_ns = int(t[last - 1])
            first = last

    def _topic(self, name: str) -> _Topic:
        if name not in self._topics:
            raise StreamError(unknown("stream", name, self._topics))
        return self._topics[name]

    def _room(self, t: Int64[np.ndarray, " n"], first: int, size: int) -> int:
        """How far samples of `size` bytes from `first` on still fit in the pending chunk; an empty one takes any."""
        if self._pending.start_ns is None:
            start_ns, rows = int(t[first]), max(1, CHUNK_BYTES // size)
        else:
            start_ns, rows = self._pending.start_ns, max(0, CHUNK_BYTES - self._pending.size) // size
        return max(first, min(int(np.searchsorted(t, start_ns + CHUNK_NS)), first + rows))

    def write_messages(self, name: str, messages: Messages) -> None:
        """Append messages, as they are.

        Raises:
            StreamError: If no topic of that name and type was added.
        """
        if name not in self._others or self._others[name].type != messages.type:
            raise StreamError(unknown("topic of messages", name, self._others))
        other = self._others[name]
        pending = self._pending_images if other.type.name in _COMPRESSED_ALREADY else self._pending
        stamps = zip(messages.t.tolist(), messages.received.tolist(), messages.sequence.tolist(), strict=True)
        for (t, received, sequence), payload in zip(stamps, messages.payloads, strict=True):
            head = record_header(other.channel, len(payload), sequence, t, received)
            record = pending.reserve(other.channel, np.array([received]), len(head) + len(payload))[0]
            record[: len(head)] = np.frombuffer(head, np.uint8)
            record[len(head) :] = np.frombuffer(payload, np.uint8)
            other.count += 1
            if pending.size > CHUNK_BYTES:
                self.flush()

    def event(self, event: Event) -> None:
        """Append an event, stamped with its start.

        Raises:
            StreamError: If its time cannot be represented.
        """
        if not 0 <= event.start_ns <= event.stop_ns <= _LAST_NS:
            raise StreamError(f"event '{event.kind}' takes times from 0 to {_LAST_NS} ns, got {event.start_ns}.")
        text = json.dumps({key: asdict(event)[key] for key in ("kind", "label", "start_ns", "stop_ns")})
        cdr = codec.encode(schemas.EVENT_MESSAGE, {"data": text})
        record = record_header(_EVENTS_CHANNEL, len(cdr), self._n_events, event.start_ns) + cdr
        place = self._pending.reserve(_EVENTS_CHANNEL, np.array([event.start_ns]), len(record))
        place[0] = np.frombuffer(record, np.uint8)
        self._n_events += 1

    def flush(self) -> None:
        """End the current chunk and hand it to the operating system."""
        self._begin()
        for pending, compression in ((self._pending, None), (self._pending_images, "none")):
            if pending.size:
                self._sink.add_chunk(pending.records, pending.index, compression)
                pending.clear()

    def sync(self) -> None:
        """Make sure that the chunks so far survive a loss of power; may take tens of milliseconds."""
        self._sink.sync()

    def finish(self, result: Any = None, recorded: Any = None, safety: Any = None) -> None:
        """Complete the file and give it its final name.

        Args:
            result: A JSON value that says what came of the episode; None leaves it out.
            recorded: A JSON value that says how the recording went; None leaves it out.
            safety: A JSON value that says what the safety layer did; None leaves it out.

        Raises:
            OutputError: If the file cannot be completed.
            StreamError: If JSON cannot hold the result.
        """
        closing = {"result": result, "safety": safety, "recorded": recorded}
        entries = {key: _json(key, value) for key, value in closing.items() if value is not None}
        self.flush()
        topics = {**self._topics, **self._others}
        counts = {"/" + EVENTS: self._n_events} | {f"/{name}": topic.count for name, topic in topics.items()}
        self._sink.add_metadata(RESULT, entries | {"message_counts": json.dumps(counts)})
        self._sink.finish()
        self._finished = True

    def _begin(self) -> None:
        """Write what precedes the first chunk."""
        if self._started:
            return
        self._started = True
        streams = {name: asdict(topic.layout.signal) | {"frame": topic.frame} for name, topic in self._topics.items()}
        self._sink.add_metadata(METADATA, self._start | {"streams": json.dumps(streams)})
        for name, attached in self._attachments.items():
            self._sink.add_attachment(name, attached)
        types = {EVENTS: schemas.message_type(schemas.EVENT_MESSAGE)}
        for name, topic in self._topics.items():
            types[name] = schemas.message_type(schemas.message_of(topic.layout.signal))
        types |= {name: other.type for name, other in self._others.items()}
        # A type is told from another by its schema; 0 stands for a topic without one.
        keys = {name: (of.name, of.schema_encoding, of.definition) for name, of in types.items()}
        ids = {key: i + 1 for i, key in enumerate(dict.fromkeys(key for key in keys.values() if any(key)))}
        for (message, encoding, text), id in ids.items():
            self._sink.define(Schema(id=id, data=text, encoding=encoding, name=message))
        channels = {name: topic.channel for name, topic in {**self._topics, **self._others}.items()}
        for name, of in types.items():
            self._sink.define(
                Channel(
                    id=channels.get(name, _EVENTS_CHANNEL),
                    topic=f"/{name}",
                    message_encoding=of.encoding,
                    metadata={},
                    schema_id=ids.get(keys[name], 0),
                )
            )


def _json(key: str, value: Any) -> str:
    try:
        return json.dumps(value)
    except (TypeError, ValueError) as error:
        raise StreamError(f"meta '{key}' cannot be recorded: {str(error).lower()}. It takes JSON values.") from error
