"""Which channels of a file are streams, which are events, and which are messages that are kept as they are."""

from collections.abc import Hashable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass

from mcap.well_known import MessageEncoding

from wrenchflow.errors import RecordingError
from wrenchflow.messages import MessageType
from wrenchflow.recording import schemas
from wrenchflow.recording.container import Container
from wrenchflow.recording.file_format import EVENTS
from wrenchflow.recording.head import Head
from wrenchflow.recording.topic import Topic, record_at


@dataclass(frozen=True)
class Channels:
    """The channels of a file by what they are. Every channel is one of these, so nothing is dropped.

    Attributes:
        streams: Of each stream, by its name.
        messages: Type and channels of each topic of other messages, by its name.
        events: Those of our events.
        chunks: Numbers of the chunks that hold messages of a channel, in the order of the file.
    """

    streams: Mapping[str, tuple[Topic, ...]]
    messages: Mapping[str, tuple[MessageType, tuple[int, ...]]]
    events: tuple[int, ...]
    chunks: Mapping[int, tuple[int, ...]]


def sort_channels(container: Container, head: Head) -> Channels:
    """Tell streams from other messages.

    In our files the metadata says which is which. In those of others a stream is what the first message of a channel
    can be read as. Channels of one topic that say the same make up one stream; where they do not, all but the first
    are called after the topic with a number behind it.

    Raises:
        RecordingError: If a chunk is damaged, or the messages of a stream are not what its metadata says.
    """
    chunks: dict[int, list[int]] = {}
    for number, chunk in enumerate(container.chunks):
        for id in container.index(chunk):
            chunks.setdefault(id, []).append(number)
    topics = dict(_ours(container, head) if head.is_ours else _others(container, chunks))
    events = [
        id
        for id, channel in container.channels.items()
        if head.is_ours and channel.topic == f"/{EVENTS}" and _is_cdr(container, id, {schemas.EVENT_MESSAGE})
    ]
    names = _Names()
    streams: dict[str, tuple[Topic, ...]] = {}
    messages: dict[str, tuple[MessageType, tuple[int, ...]]] = {}
    for id, channel in container.channels.items():
        topic = channel.topic.removeprefix("/")
        if stream := topics.get(id):
            name = names.of(topic, (stream.signal, stream.frame))
            streams[name] = (*streams.get(name, ()), stream)
        elif id not in events:
            kind = _type(container, id)
            name = names.of(topic, kind)
            messages[name] = kind, (*messages.get(name, (kind, ()))[1], id)
    order = [*(name for name in head.streams if name in streams), *sorted(streams.keys() - head.streams.keys())]
    return Channels(
        streams={name: streams[name] for name in order},
        messages=messages,
        events=tuple(events),
        chunks={id: tuple(numbers) for id, numbers in chunks.items()},
    )


class _Names:
    """Names for what topics hold: one where they hold one thing, several where they hold several."""

    def __init__(self) -> None:
        self._taken: dict[str, Hashable] = {}

    def of(self, topic: str, what: Hashable) -> str:
        name, number = topic, 1
        while self._taken.setdefault(name, what) != what:
            number += 1
            name = f"{topic}.{number}"
        return name


def _is_cdr(container: Container, channel: int, messages: set[str] | frozenset[str]) -> bool:
    is_cdr = container.channels[channel].message_encoding == MessageEncoding.CDR
    return is_cdr and container.schema_name(channel) in messages


def _ours(container: Container, head: Head) -> Iterator[tuple[int, Topic]]:
    for id, channel in container.channels.items():
        message, name = container.schema_name(id), channel.topic.removeprefix("/")
        if name not in head.streams:
            continue
        signal, frame = head.streams[name]
        if schemas.message_of(signal) != message or not _is_cdr(container, id, {message}):
            raise RecordingError(
                f"topic '{channel.topic}' of {container.path} cannot be read: "
                f"its metadata says '{signal.kind}', but its messages are {message}."
            )
        yield id, Topic(id, message, signal, frame)


def _others(container: Container, chunks: Mapping[int, list[int]]) -> Iterator[tuple[int, Topic]]:
    """The channels that can be read as streams, going by their first message."""
    candidates = [id for id in chunks if _is_cdr(container, id, schemas.STREAM_MESSAGES)]
    for id in sorted(candidates, key=lambda id: chunks[id][0]):
        chunk = container.chunks[chunks[id][0]]
        topic = Topic(id, container.schema_name(id))
        offset, data = int(container.index(chunk)[id][0, 1]), container.unpack(chunk)
        with suppress(RecordingError):  # Messages that are not what their type says here are kept as they are.
            if topic.begin(record_at(data, offset, id)):
                yield id, topic


def _type(container: Container, channel: int) -> MessageType:
    record = container.channels[channel]
    schema = container.schemas.get(record.schema_id)
    return MessageType(
        name=schema.name if schema else "",
        definition=schema.data if schema else b"",
        schema_encoding=schema.encoding if schema else "",
        encoding=record.message_encoding,
    )
