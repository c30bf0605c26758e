"""MCAP files to episodes and to summaries: ours bit for bit, and those of other writers as far as their types tell."""

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mcap.well_known import MessageEncoding

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import RecordingError, StreamError
from wrenchflow.recording import codec, schemas
from wrenchflow.recording.container import Container
from wrenchflow.recording.file_format import EVENTS, FORMAT_VERSION, META_PREFIX, METADATA, RESULT
from wrenchflow.recording.layout import HEADER
from wrenchflow.recording.topic import Topic, record_at
from wrenchflow.signals import Signal


def find_recordings(folder: Path) -> list[Path]:
    """The `*.mcap` of a folder, in the order of their names.

    Raises:
        RecordingError: If it is no folder, or holds none.
    """
    if not folder.exists():
        raise RecordingError(f"folder '{folder}' does not exist.")
    if not folder.is_dir():
        raise RecordingError(f"'{folder}' is a file, expected a folder of *.mcap.")
    paths = sorted(folder.glob("*.mcap"))
    if not paths:
        found = ", ".join(sorted(entry.name for entry in folder.iterdir())[:5]) or "nothing"
        raise RecordingError(f"folder '{folder}' holds no *.mcap, got {found}.")
    return paths


@dataclass(frozen=True, kw_only=True)
class TopicInfo:
    """What a file says about one topic.

    Attributes:
        name: The topic, with its leading slash.
        schema: Its message type.
        count: Number of messages.
        rate_hz: Mean rate [Hz]; None for fewer than two messages.
        start_ns: Log time of the first message [ns]; None without one.
        stop_ns: Log time of the last message [ns]; None without one.
    """

    name: str
    schema: str
    count: int
    rate_hz: float | None
    start_ns: int | None
    stop_ns: int | None


@dataclass(frozen=True, kw_only=True)
class RecordingInfo:
    """What a file says about itself, without a look into its messages.

    Attributes:
        id: Name of the episode.
        task: The task that was attempted; empty in files of other writers.
        meta: JSON values; empty in files of other writers.
        topics: In the order of their names.
        duration_s: From the first to the last message [s].
        size_bytes: Length of the file.
    """

    id: str
    task: str
    meta: Mapping[str, Any]
    topics: tuple[TopicInfo, ...]
    duration_s: float
    size_bytes: int


@dataclass(frozen=True)
class _Head:
    """What our metadata records say; of another writer's file, what its name says."""

    id: str
    task: str = ""
    meta: Mapping[str, Any] = field(default_factory=dict)
    streams: Mapping[str, tuple[Signal, str]] = field(default_factory=dict)
    is_ours: bool = False


def read_episode(path: Path, streams: Collection[str] | None = None) -> Episode:
    """Read a recording.

    Topics whose messages are none of those in `schemas` (images, for example) are left out. Time is the stamp in the
    message's header, or the publish time where it has none.

    Args:
        path: A finished MCAP file.
        streams: Names of the streams to read; None reads all. Events are always read.

    Raises:
        RecordingError: If the file is missing, unfinished, damaged or not MCAP, if it lacks one of `streams`, or if a
            topic is not a stream (its stamps repeat, or its frame changes).
    """
    container = Container(path)
    head = _read_head(container)
    topics, events = _read_messages(container, head, streams)
    found = {name: _stream(container, name, parts) for name, parts in topics.items()}
    for name, (signal, frame) in head.streams.items():
        if name not in found and (streams is None or name in streams):
            empty = np.empty(0, np.int64), np.empty((0, signal.width))
            found[name] = Stream(*empty, signal, frame)
    for name in streams or ():
        if name not in found:
            available = sorted({*head.streams, *found, *_stream_names(container)})
            raise RecordingError(f"stream '{name}' is not in {path}. It has: {', '.join(available) or 'none'}.")
    order = [*head.streams, *sorted(found.keys() - head.streams.keys())]
    ordered = {name: found[name] for name in order if name in found}
    return Episode(head.id, head.task, ordered, tuple(events), head.meta, attachments=container.attachments)


def read_info(path: Path) -> RecordingInfo:
    """Read what a recording says about itself; chunks are not decompressed unless they have no index.

    Args:
        path: A finished MCAP file.

    Raises:
        RecordingError: If the file is missing, unfinished, damaged or not MCAP.
    """
    container = Container(path)
    head = _read_head(container)
    counts: dict[int, int] = {}
    spans: dict[int, tuple[int, int]] = {}
    for chunk in container.chunks:
        for channel, index in container.index(chunk).items():
            first, last = int(index[:, 0].min()), int(index[:, 0].max())
            start, stop = spans.get(channel, (first, last))
            spans[channel] = min(start, first), max(stop, last)
            counts[channel] = counts.get(channel, 0) + len(index)
    topics = []
    for id, channel in container.channels.items():
        start, stop = spans.get(id, (None, None))
        count = counts.get(id, 0)
        rate_hz = (
            (count - 1) / (stop - start) * 1e9 if start is not None and stop is not None and stop > start else None
        )
        name, schema = channel.topic, _schema_name(container, id)
        topics.append(TopicInfo(name=name, schema=schema, count=count, rate_hz=rate_hz, start_ns=start, stop_ns=stop))
    start = min((start for start, _ in spans.values()), default=0)
    stop = max((stop for _, stop in spans.values()), default=0)
    return RecordingInfo(
        id=head.id,
        task=head.task,
        meta=head.meta,
        topics=tuple(sorted(topics, key=lambda topic: topic.name)),
        duration_s=(stop - start) * 1e-9,
        size_bytes=container.size,
    )


def _read_head(container: Container) -> _Head:
    if METADATA not in container.metadata:
        return _Head(container.path.stem)
    entries = container.metadata[METADATA]
    result = container.metadata.get(RESULT, {})
    try:
        version = int(entries["format_version"])
        if version > FORMAT_VERSION:
            raise RecordingError(
                f"{container.path} has format version {version}; this wrenchflow reads versions up to {FORMAT_VERSION}."
            )
        meta = {
            key.removeprefix(META_PREFIX): json.loads(entries[key]) for key in entries if key.startswith(META_PREFIX)
        }
        meta |= {key: json.loads(result[key]) for key in ("result", "recorded") if key in result}
        streams = {
            name: (Signal(of["kind"], tuple(of["columns"]), tuple(of["units"])), of["frame"])
            for name, of in json.loads(entries["streams"]).items()
        }
        return _Head(entries["id"], entries["task"], meta, streams, is_ours=True)
    except (KeyError, TypeError, ValueError, StreamError) as error:
        raise container.damaged(f"its '{METADATA}' metadata cannot be read ({error})") from error


def _schema_name(container: Container, channel: int) -> str:
    """The message type of a channel; empty where it has none that we could read."""
    record = container.channels[channel]
    schema = container.schemas.get(record.schema_id)
    return schema.name if schema else ""


def _is_stream(container: Container, channel: int) -> bool:
    is_cdr = container.channels[channel].message_encoding == MessageEncoding.CDR
    return is_cdr and _schema_name(container, channel) in schemas.STREAM_MESSAGES


def _stream_name(container: Container, channel: int) -> str:
    return container.channels[channel].topic.removeprefix("/")


def _stream_names(container: Container) -> list[str]:
    return [_stream_name(container, id) for id in container.channels if _is_stream(container, id)]


def _read_messages(
    container: Container, head: _Head, streams: Collection[str] | None
) -> tuple[dict[str, list[Topic]], list[Event]]:
    """Read the wanted channels, by the name of the stream that they belong to, and the events."""
    topics: dict[int, Topic] = {}
    events: list[Event] = []
    counts: dict[int, int] = {}

    def is_events(channel: int) -> bool:
        is_string = _schema_name(container, channel) == schemas.EVENT_MESSAGE
        return head.is_ours and is_string and _stream_name(container, channel) == EVENTS

    def is_wanted(channel: int) -> bool:
        return _is_stream(container, channel) and (streams is None or _stream_name(container, channel) in streams)

    for chunk in container.chunks:
        if not any(is_events(id) or is_wanted(id) for id in container.index(chunk)):
            continue
        data = container.unpack(chunk)
        for id, index in chunk.index.items():
            counts[id] = counts.get(id, 0) + len(index)
            name = container.channels[id].topic
            try:
                if is_events(id):
                    events += [_event(record_at(data, int(offset), id)) for offset in index[:, 1]]
                elif is_wanted(id):
                    topics.setdefault(id, _topic(container, head, id)).read(data, index)
            except RecordingError as error:
                raise RecordingError(f"topic '{name}' of {container.path} cannot be read: {error}") from error

    stated = container.statistics.channel_message_counts if container.statistics else {}
    for id in container.channels:
        if (is_events(id) or is_wanted(id)) and stated and stated.get(id, 0) != counts.get(id, 0):
            name = container.channels[id].topic
            raise container.damaged(f"'{name}' has {counts.get(id, 0)} messages where {stated.get(id, 0)} are stated")
    by_name: dict[str, list[Topic]] = {}
    for id, topic in topics.items():
        if topic.samples:
            by_name.setdefault(_stream_name(container, id), []).append(topic)
    return by_name, events


def _topic(container: Container, head: _Head, channel: int) -> Topic:
    message = _schema_name(container, channel)
    signal, frame = head.streams.get(_stream_name(container, channel), (None, None))
    if signal is not None and schemas.message_of(signal) != message:
        raise RecordingError(f"its metadata says '{signal.kind}', but its messages are {message}.")
    return Topic(channel, message, signal, frame)


def _event(record: bytes) -> Event:
    text = codec.decode(schemas.EVENT_MESSAGE, record[HEADER.itemsize :])["data"].value
    try:
        return Event(**json.loads(text))
    except (TypeError, ValueError, StreamError) as error:
        raise RecordingError(f"'{text}' is not an event.") from error


def _stream(container: Container, name: str, topics: list[Topic]) -> Stream:
    """The one stream that the channels of a topic make up."""
    first = topics[0]
    if any((topic.signal, topic.frame) != (first.signal, first.frame) for topic in topics):
        raise RecordingError(f"topic '/{name}' of {container.path} has channels that measure different things.")
    stamps, publish, data = (
        np.concatenate(parts) for parts in zip(*(part for topic in topics for part in topic.samples), strict=True)
    )
    # A header whose stamp is zero in every message was never filled in.
    t = stamps if stamps.any() else publish
    if (t[1:] < t[:-1]).any():
        order = np.argsort(t, kind="stable")
        t, data = t[order], data[order]
    assert first.signal is not None
    try:
        return Stream(t, data, first.signal, first.frame or "")
    except StreamError as error:
        raise RecordingError(f"topic '/{name}' of {container.path} cannot be a stream: {error}") from error
