"""Episodes to MCAP files: chunks by time, whole columns at once, and equal bytes for equal data."""

import json
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from jaxtyping import Float, Int64
from mcap.records import Channel, Schema
from mcap.well_known import MessageEncoding, SchemaEncoding

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import StreamError, unknown
from wrenchflow.recording import codec, schemas
from wrenchflow.recording.layout import SECOND_NS, Layout, record_header
from wrenchflow.recording.pending import CHUNK_BYTES, CHUNK_NS, PendingChunk
from wrenchflow.recording.sink import Sink
from wrenchflow.signals import Signal

FORMAT_VERSION = 1
EVENTS = "events"
# Names of the metadata records at the start and at the end, and the prefix that keeps our entries and `meta` apart.
METADATA = "wrenchflow"
RESULT = "wrenchflow/result"
META_PREFIX = "meta."

# Cutting a window into equal times does not cut it into equal bytes, so we aim lower than the limit.
_TARGET_BYTES = CHUNK_BYTES * 9 // 10
# `header.stamp` holds int32 seconds.
_LAST_NS = 2**31 * SECOND_NS - 1
_EVENTS_CHANNEL = 1


@dataclass
class _Topic:
    """A stream that is being written: how, and how far."""

    channel: int
    layout: Layout
    frame: str
    count: int = 0
    last_ns: int = -1


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
        self, path: Path, *, id: str, task: str, meta: Mapping[str, Any] | None = None, compression: str = "zstd"
    ) -> None:
        """Start the file.

        Args:
            path: Where the finished file goes.
            id: Name of the episode.
            task: The task that is attempted.
            meta: JSON values that are known at the start.
            compression: One of `compression.NAMES`.

        Raises:
            ConfigError: If there is no such compression.
            OutputError: If the path is taken or cannot be written.
            StreamError: If `meta` holds what JSON cannot.
        """
        entries = {META_PREFIX + key: _json(key, value) for key, value in (meta or {}).items()}
        self._start = {"format_version": str(FORMAT_VERSION), "id": id, "task": task, **entries}
        self._topics: dict[str, _Topic] = {}
        self._n_events = 0
        self._pending = PendingChunk()
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
        if self._started:
            raise StreamError(
                f"stream '{name}' comes too late: all streams are added before the first chunk is written."
            )
        if name in self._topics or name == EVENTS:
            raise StreamError(f"stream '{name}' cannot be added: the name is taken.")
        channel = _EVENTS_CHANNEL + 1 + len(self._topics)
        self._topics[name] = _Topic(channel, Layout.for_stream(signal, frame, channel), frame)

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
        topic = self._check(name, t, rows)
        self._append(topic, t, rows, received, sequence)

    def _check(self, name: str, t: Int64[np.ndarray, " n"], rows: Float[np.ndarray, "n d"]) -> _Topic:
        if name not in self._topics:
            raise StreamError(unknown("stream", name, self._topics))
        topic = self._topics[name]
        Stream(t, rows, topic.layout.signal)
        if len(t) and not (topic.last_ns < t[0] and t[-1] <= _LAST_NS):
            raise StreamError(
                f"stream '{name}' takes stamps after {topic.last_ns} ns and up to {_LAST_NS}, got {t[0]} to {t[-1]}."
            )
        topic.layout.check(rows)
        return topic

    def _append(
        self,
        topic: _Topic,
        t: Int64[np.ndarray, " n"],
        rows: Float[np.ndarray, "n d"],
        received: Int64[np.ndarray, " n"] | None = None,
        sequence: Int64[np.ndarray, " n"] | None = None,
    ) -> None:
        """Encode samples that were checked, and end a chunk whenever it is full."""
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

    def _room(self, t: Int64[np.ndarray, " n"], first: int, size: int) -> int:
        """How far samples of `size` bytes from `first` on still fit in the pending chunk; an empty one takes any."""
        if self._pending.start_ns is None:
            start_ns, rows = int(t[first]), max(1, CHUNK_BYTES // size)
        else:
            start_ns, rows = self._pending.start_ns, max(0, CHUNK_BYTES - self._pending.size) // size
        return max(first, min(int(np.searchsorted(t, start_ns + CHUNK_NS)), first + rows))

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

    def write_together(self, streams: Mapping[str, Stream], events: Collection[Event] = ()) -> None:
        """Append several streams, so that each chunk holds all that happened in one window of time.

        Args:
            streams: Samples by the name of the stream that they go to.
            events: Events of the same time.
        """
        topics = {name: self._check(name, stream.t, stream.data) for name, stream in streams.items()}
        ordered = sorted(events)
        moments = {name: stream.t for name, stream in streams.items() if len(stream)}
        if ordered:
            moments[EVENTS] = np.array([event.start_ns for event in ordered])
        done = dict.fromkeys(moments, 0)
        while left := [name for name in moments if done[name] < len(moments[name])]:
            start = min(int(moments[name][done[name]]) for name in left)
            stop = min(start + CHUNK_NS, 1 + max(int(moments[name][-1]) for name in left))
            size = sum(
                (int(np.searchsorted(moments[name], stop)) - done[name]) * topics[name].layout.size
                for name in left
                if name != EVENTS
            )
            pieces = -(-size // _TARGET_BYTES) or 1
            for piece in range(1, pieces + 1):
                edge = start + (stop - start) * piece // pieces
                for name in left:
                    first, last = done[name], int(np.searchsorted(moments[name], edge))
                    if name == EVENTS:
                        for event in ordered[first:last]:
                            self.event(event)
                    elif last > first:
                        self._append(topics[name], moments[name][first:last], streams[name].data[first:last])
                    done[name] = last
                self.flush()

    def flush(self) -> None:
        """End the current chunk and hand it to the operating system."""
        self._begin()
        if self._pending.size:
            self._sink.add_chunk(self._pending.records, self._pending.index)
            self._pending.clear()

    def sync(self) -> None:
        """Make sure that the chunks so far survive a loss of power; may take tens of milliseconds."""
        self._sink.sync()

    def finish(self, result: Any = None, recorded: Any = None) -> None:
        """Complete the file and give it its final name.

        Args:
            result: A JSON value that says what came of the episode; None leaves it out.
            recorded: A JSON value that says how the recording went; None leaves it out.

        Raises:
            OutputError: If the file cannot be completed.
            StreamError: If JSON cannot hold the result.
        """
        entries = {} if result is None else {"result": _json("result", result)}
        if recorded is not None:
            entries["recorded"] = _json("recorded", recorded)
        self.flush()
        counts = {"/" + EVENTS: self._n_events} | {f"/{name}": topic.count for name, topic in self._topics.items()}
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
        messages = {EVENTS: schemas.EVENT_MESSAGE}
        messages |= {name: schemas.message_of(topic.layout.signal) for name, topic in self._topics.items()}
        ids = {message: i + 1 for i, message in enumerate(dict.fromkeys(messages.values()))}
        for message, id in ids.items():
            text = schemas.definition(message).encode()
            self._sink.define(Schema(id=id, data=text, encoding=SchemaEncoding.ROS2, name=message))
        for channel, (name, message) in enumerate(messages.items(), _EVENTS_CHANNEL):
            self._sink.define(
                Channel(
                    id=channel,
                    topic=f"/{name}",
                    message_encoding=MessageEncoding.CDR,
                    metadata={},
                    schema_id=ids[message],
                )
            )


def write_episode(path: Path, episode: Episode, compression: str = "zstd") -> None:
    """Write a whole episode; `meta["result"]` goes into the record at the end. Equal episodes give equal bytes.

    Args:
        path: Where the file goes; until it is complete it is called `<path>.partial`.
        episode: What to write.
        compression: Of the chunks: one of `compression.NAMES`.

    Raises:
        OutputError: If the path is taken or cannot be written.
        StreamError: If a value cannot be represented in the message that carries it.
    """
    result = episode.meta.get("result")
    meta = {key: value for key, value in episode.meta.items() if key != "result" or result is None}
    with EpisodeWriter(path, id=episode.id, task=episode.task, meta=meta, compression=compression) as writer:
        for name, stream in episode.streams.items():
            writer.add_stream(name, stream.signal, stream.frame)
        writer.write_together(episode.streams, episode.events)
        writer.finish(result)


def _json(key: str, value: Any) -> str:
    try:
        return json.dumps(value)
    except (TypeError, ValueError) as error:
        raise StreamError(f"meta '{key}' cannot be recorded: {str(error).lower()}. It takes JSON values.") from error
