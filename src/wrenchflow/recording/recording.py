"""A recording that is opened once and read in parts: some of its topics, some of its time."""

import json
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import RecordingError, StreamError
from wrenchflow.messages import Messages
from wrenchflow.recording import codec, schemas
from wrenchflow.recording.channels import Channels, sort_channels
from wrenchflow.recording.container import Container
from wrenchflow.recording.head import read_head
from wrenchflow.recording.info import RecordingInfo, info_of
from wrenchflow.recording.kept import messages_of
from wrenchflow.recording.layout import HEADER
from wrenchflow.recording.spans import Spans
from wrenchflow.recording.topic import Samples, Topic, check_room, record_at
from wrenchflow.signals import Signal

_FIRST_NS, _LAST_NS = -(2**63), 2**63 - 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Rows:
    """What the messages of a topic say in the order of the file, before anybody asks whether they make a stream.

    Attributes:
        stamp: Times in their headers [ns]; None if they have no header, or nobody filled it in. Shape (n,).
        publish: When they were sent, as the file says [ns]. Shape (n,).
        data: Rows of the signal. Shape (n, d).
        signal: What they measure.
        frame: Their frame.
    """

    stamp: Int64[np.ndarray, " n"] | None
    publish: Int64[np.ndarray, " n"]
    data: Float[np.ndarray, "n d"]
    signal: Signal
    frame: str


class Recording:
    """An MCAP file whose structure was read, and whose messages are read when they are asked for.

    recording = Recording(path)
    for part in recording.windows(60_000_000_000, ["wrench_raw"]):
        look_at(part["wrench_raw"])
    """

    def __init__(self, path: Path) -> None:
        """Open a finished MCAP file; chunks stay compressed.

        Raises:
            RecordingError: If the file is missing, unfinished, truncated, damaged or not MCAP.
        """
        self.path = path
        self._container = Container(path)
        self._head = read_head(self._container)
        self._kept: dict[str, Messages] = {}

    @cached_property
    def info(self) -> RecordingInfo:
        """What the file says about itself; chunks are decompressed only where they have no index."""
        return info_of(self._container, self._head)

    @property
    def streams(self) -> tuple[str, ...]:
        """Names of the streams. In a file of another writer this looks at the first message of each topic."""
        return tuple(dict.fromkeys((*self._head.streams, *self._channels.streams)))

    @property
    def messages(self) -> tuple[str, ...]:
        """Names of the topics that are no streams, and are kept as they are."""
        return tuple(self._channels.messages)

    @cached_property
    def _channels(self) -> Channels:
        return sort_channels(self._container, self._head)

    @cached_property
    def _spans(self) -> Spans:
        return Spans(self._container, self._channels.chunks, is_ours=self._head.is_ours)

    def read(
        self,
        streams: Collection[str] | None = None,
        *,
        messages: Collection[str] | None = None,
        start_ns: int | None = None,
        stop_ns: int | None = None,
    ) -> Episode:
        """Read all of it, or a part. What lies in chunks that are not needed costs nothing.

        The checksum of a chunk is looked at when it is read, and the one over the whole file when all chunks are.

        Args:
            streams: Names of the streams to read; None reads all.
            messages: Names of the other topics to read; None reads all of them where all streams are read, else none.
            start_ns: Leave out samples and messages before this time, and events that start before it [ns].
            stop_ns: Leave out those from this time on [ns].

        Returns:
            The episode. Time is the stamp in a message's header, or the publish time where no message of the topic has
            one. Messages that are no streams are in the order of the file, and their bytes are read when they are
            asked for.

        Raises:
            RecordingError: If the file is damaged, if it lacks one of the names, or if a topic is not a stream after
                all (its stamps repeat, or its frame changes).
        """
        names = self._named("stream", streams, self.streams)
        kept = self._named("topic", messages if messages is not None or streams is None else (), self.messages)
        is_part = start_ns is not None or stop_ns is not None
        first_ns, last_ns = _FIRST_NS if start_ns is None else start_ns, _LAST_NS if stop_ns is None else stop_ns
        self._check(names, kept, is_whole=not is_part)
        topics = {name: self._channels.streams.get(name, ()) for name in names}
        if is_part:
            self._spans.learn([topic for of in topics.values() for topic in of])
        chunks: dict[int, tuple[int, ...]] = {}
        for of in topics.values():
            numbers = self._spans.chunks(of, first_ns, last_ns) if is_part else map(self._chunks_of, of)
            chunks |= {topic.channel: part for topic, part in zip(of, numbers, strict=True)}
        samples = self._samples([topic for of in topics.values() for topic in of], chunks)
        found = {}
        for name, of in topics.items():
            is_stamped = self._spans.is_stamped(of) if is_part else None
            found[name] = self._stream(name, of, [samples[topic.channel] for topic in of], is_stamped)
        if is_part:
            found = {name: stream.between(first_ns, last_ns) for name, stream in found.items()}
        return Episode(
            self._head.id,
            self._head.task,
            found,
            tuple(self._events(first_ns, last_ns)),
            self._head.meta,
            {name: self._messages(name, first_ns, last_ns, is_part=is_part) for name in kept},
            self._container.attachments,
        )

    def rows(self, name: str) -> Rows:
        """All messages of one stream of another writer, whatever their stamps are.

        Args:
            name: Of the stream. Where several channels make it up, their messages come by the time they were sent.

        Raises:
            RecordingError: If the file is damaged, lacks the name, or if the topic's frame changes.
        """
        names = self._named("stream", (name,), self.streams)
        self._check(names, (), is_whole=True)
        topics = list(self._channels.streams.get(name, ()))
        read = self._samples(topics, {topic.channel: self._chunks_of(topic) for topic in topics})
        if not topics:
            signal, frame = self._head.streams[name]
            none = np.empty(0, np.int64)
            return Rows(stamp=none, publish=none, data=np.empty((0, signal.width)), signal=signal, frame=frame)
        stamp, publish, data = _joined([read[topic.channel] for topic in topics])
        if len(topics) > 1:
            order = np.argsort(publish, kind="stable")
            stamp, publish, data = stamp[order], publish[order], data[order]
        signal, has_header = topics[0].signal, schemas.has_header(topics[0].message)
        assert signal is not None
        return Rows(
            stamp=stamp if has_header and (stamp.any() or not len(stamp)) else None,
            publish=publish,
            data=data,
            signal=signal,
            frame=topics[0].frame or "",
        )

    def windows(
        self,
        length_ns: int,
        streams: Collection[str] | None = None,
        *,
        messages: Collection[str] | None = None,
        start_ns: int | None = None,
        stop_ns: int | None = None,
    ) -> Iterator[Episode]:
        """Walk through a long file, holding one window of it at a time.

        Args:
            length_ns: How long a window is [ns].
            streams: As in `read`.
            messages: As in `read`.
            start_ns: Where the first window starts [ns]; without it, at the first thing that is read.
            stop_ns: Where the last one ends [ns].

        Yields:
            What `read` gives for each window in turn; those in which nothing happened are left out.

        Raises:
            RecordingError: As `read` does, or if `length_ns` is not positive.
        """
        if length_ns < 1:
            raise RecordingError(f"a window takes a length of at least 1 ns, got {length_ns}.")
        last_ns = _LAST_NS if stop_ns is None else stop_ns
        names = self._named("stream", streams, self.streams)
        kept = self._named("topic", messages if messages is not None or streams is None else (), self.messages)
        at = self._next_ns(names, kept, _FIRST_NS if start_ns is None else start_ns)
        origin = at if start_ns is None else start_ns
        while at is not None and origin is not None and at < last_ns:
            at -= (at - origin) % length_ns
            window = self.read(names, messages=kept, start_ns=at, stop_ns=min(at + length_ns, last_ns))
            at += length_ns
            if any(map(len, (*window.streams.values(), *window.messages.values(), window.events))):
                yield window
            else:
                at = self._next_ns(names, kept, at)

    def _next_ns(self, names: Collection[str], kept: Collection[str], t_ns: int) -> int | None:
        """When the first thing at `t_ns` or later happened; None if nothing did."""
        times = [event.start_ns for event in self._events(t_ns, _LAST_NS)]
        times += [int(t[t >= t_ns].min(initial=_LAST_NS)) for t in (self._whole(name).t for name in kept)]
        for name in names:
            topics = self._channels.streams.get(name, ())
            for topic, numbers in zip(topics, self._spans.chunks(topics, t_ns, _LAST_NS), strict=True):
                for number in numbers:
                    samples = self._samples([topic], {topic.channel: (number,)})[topic.channel]
                    t = samples.stamp if self._spans.is_stamped(topics) else samples.publish
                    times.append(int(t[t >= t_ns].min(initial=_LAST_NS)))
                    if self._head.is_ours and times[-1] < _LAST_NS:
                        break  # What follows is later.
        first_ns = min(times, default=_LAST_NS)
        return first_ns if first_ns < _LAST_NS else None

    def _named(self, what: str, wanted: Collection[str] | None, there: tuple[str, ...]) -> tuple[str, ...]:
        for name in wanted or ():
            if name not in there:
                available = ", ".join(sorted(there)) or "none"
                raise RecordingError(f"{what} '{name}' is not in {self.path}. It has: {available}.")
        return there if wanted is None else tuple(name for name in there if name in wanted)

    def _chunks_of(self, topic: Topic) -> tuple[int, ...]:
        return tuple(self._channels.chunks.get(topic.channel, ()))

    def _check(self, names: Collection[str], kept: Collection[str], *, is_whole: bool) -> None:
        """Compare counts with those that are stated; look at the checksum over all where all chunks are read."""
        container, chunks = self._container, self._channels.chunks
        ids = [topic.channel for name in names for topic in self._channels.streams.get(name, ())]
        ids += [id for name in kept for id in self._channels.messages[name][1]]
        ids += self._channels.events
        stated = container.statistics.channel_message_counts if container.statistics else {}
        for id in ids:
            count = sum(len(container.index(container.chunks[number])[id]) for number in chunks.get(id, ()))
            if stated and stated.get(id, 0) != count:
                topic = container.channels[id].topic
                raise container.damaged(f"'{topic}' has {count} messages where {stated.get(id, 0)} are stated")
        read = {number for id in ids for number in chunks.get(id, ())}
        if is_whole and all(read.issuperset(numbers) for numbers in chunks.values()):
            container.check()

    def _samples(self, topics: list[Topic], chunks: dict[int, tuple[int, ...]]) -> dict[int, Samples]:
        """What the messages of some channels in some chunks say, by channel."""
        container = self._container
        plan: dict[int, list[Topic]] = {}
        counts: dict[int, int] = {}
        for topic in topics:
            for number in chunks[topic.channel]:
                plan.setdefault(number, []).append(topic)
                count = len(container.index(container.chunks[number])[topic.channel])
                counts[topic.channel] = counts.get(topic.channel, 0) + count
        widths = {topic.channel: topic.signal.width for topic in topics if topic.signal is not None}
        check_room(sum(counts.get(id, 0) * (2 + width) for id, width in widths.items()), container)
        samples = {id: Samples(counts.get(id, 0), width) for id, width in widths.items()}
        for number in sorted(plan):
            chunk = container.chunks[number]
            for topic in plan[number]:
                try:
                    topic.read(container.unpack(chunk), container.index(chunk)[topic.channel], samples[topic.channel])
                except RecordingError as error:
                    raise self._unreadable(topic.channel, error) from error
        return samples

    def _unreadable(self, channel: int, error: RecordingError) -> RecordingError:
        topic = self._container.channels[channel].topic
        return RecordingError(f"topic '{topic}' of {self.path} cannot be read: {error}")

    def _stream(self, name: str, topics: tuple[Topic, ...], samples: list[Samples], is_stamped: bool | None) -> Stream:
        """The one stream that the samples of some channels make up."""
        if not topics:
            signal, frame = self._head.streams[name]
            return Stream(np.empty(0, np.int64), np.empty((0, signal.width)), signal, frame)
        signal, frame = topics[0].signal, topics[0].frame
        assert signal is not None
        stamp, publish, data = _joined(samples)
        # A header whose stamp is zero in every message was never filled in.
        t = stamp if (stamp.any() if is_stamped is None else is_stamped) else publish
        if (t[1:] < t[:-1]).any():
            order = np.argsort(t, kind="stable")
            t, data = t[order], data[order]
        try:
            return Stream(t, data, signal, frame or "")
        except StreamError as error:
            raise RecordingError(f"topic '/{name}' of {self.path} cannot be a stream: {error}") from error

    def _events(self, first_ns: int, last_ns: int) -> Iterator[Event]:
        """Our events that start in a range; the log time of their messages is their start."""
        for id in self._channels.events:
            for number in self._channels.chunks.get(id, ()):
                chunk = self._container.chunks[number]
                index = self._container.index(chunk)[id]
                logged = index[:, 0].astype(np.int64)
                for offset in index[(logged >= first_ns) & (logged <= last_ns), 1].tolist():
                    try:
                        yield _event(record_at(self._container.unpack(chunk), offset, id))
                    except RecordingError as error:
                        raise self._unreadable(id, error) from error

    def _whole(self, name: str) -> Messages:
        """All messages of a topic; they are a few numbers each, and are looked for once."""
        if name not in self._kept:
            kind, ids = self._channels.messages[name]
            numbers = sorted({number for id in ids for number in self._channels.chunks.get(id, ())})
            self._kept[name] = messages_of(self._container, kind, ids, numbers)
        return self._kept[name]

    def _messages(self, name: str, first_ns: int, last_ns: int, *, is_part: bool) -> Messages:
        messages = self._whole(name)
        return messages.between(first_ns, last_ns) if is_part else messages


def _joined(samples: list[Samples]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stamps, publish times and rows of one channel, or of several one after the other."""
    columns = zip(*((part.stamp, part.publish, part.data) for part in samples), strict=True)
    stamp, publish, data = (of[0] if len(of) == 1 else np.concatenate(of) for of in columns)
    return stamp, publish, data


def _event(record: bytes) -> Event:
    text = codec.decode(schemas.EVENT_MESSAGE, record[HEADER.itemsize :])["data"].value
    try:
        entries = json.loads(text)
        return Event(int(entries["start_ns"]), int(entries["stop_ns"]), str(entries["kind"]), str(entries["label"]))
    except (KeyError, TypeError, ValueError, RecursionError, StreamError) as error:
        raise RecordingError(f"'{text[:200]}' is not an event.") from error
