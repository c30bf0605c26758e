"""Which chunks hold a stream's samples of a range of time, so that the others stay closed."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Int64

from wrenchflow.recording.container import Container
from wrenchflow.recording.layout import HEADER
from wrenchflow.recording.topic import Samples, Topic, check_room

_PUBLISH = slice(HEADER.itemsize - 8, HEADER.itemsize)


class Spans:
    """Where the times of a file lie, learned as far as somebody asks.

    An index holds when messages were had, and that says little of when they were sampled: a sensor may answer late,
    and the clocks of a foreign file may be years apart. So the index is only a first guess.

    In our files the stamps of a stream increase from chunk to chunk, and are the publish times: from the guess we look
    at the first stamp of a chunk and its neighbours until the range is enclosed, which opens one chunk too many at
    either end. In those of others every chunk is read once, and what it spans is remembered.
    """

    def __init__(self, container: Container, chunks: Mapping[int, Sequence[int]], *, is_ours: bool) -> None:
        """Nothing is looked at yet.

        Args:
            container: The file.
            chunks: Numbers of the chunks that hold messages of a channel, in the order of the file.
            is_ours: Whether stamps increase from chunk to chunk.
        """
        self._container, self._chunks, self._is_ours = container, chunks, is_ours
        self._logged: dict[int, Int64[np.ndarray, " n"]] = {}
        self._first: dict[tuple[int, int], int] = {}
        # First and last stamp, and first and last publish time, of each chunk that holds a channel [ns].
        self._spans: dict[int, Int64[np.ndarray, "n 4"]] = {}

    def chunks(self, topics: Sequence[Topic], start_ns: int, stop_ns: int) -> list[tuple[int, ...]]:
        """Numbers of the chunks that hold all samples of a stream with start_ns <= t < stop_ns, and maybe others.

        Args:
            topics: The channels of the stream.
            start_ns: Where the range starts [ns].
            stop_ns: Where it ends [ns].
        """
        if self._is_ours:
            return [self._enclose(topic.channel, start_ns, stop_ns) for topic in topics]
        of_publish = 0 if self.is_stamped(topics) else 2
        found = []
        for topic in topics:
            first, last = self._spans[topic.channel].T[of_publish : of_publish + 2]
            numbers = np.array(self._chunks[topic.channel])
            found.append(tuple(numbers[(first < stop_ns) & (last >= start_ns)].tolist()))
        return found

    def is_stamped(self, topics: Sequence[Topic]) -> bool:
        """Whether any message of a stream has a stamp in its header that is not zero."""
        if self._is_ours:
            return True
        self.learn(topics)
        return any(bool(self._spans[topic.channel][:, :2].any()) for topic in topics)

    def learn(self, topics: Sequence[Topic]) -> None:
        """Read what the chunks of a foreign file span, of channels of which that is not known yet."""
        new = {topic.channel: topic for topic in topics if not self._is_ours and topic.channel not in self._spans}
        rows: dict[int, list[list[int]]] = {channel: [] for channel in new}
        for number in sorted({number for channel in new for number in self._chunks[channel]}):
            chunk = self._container.chunks[number]
            for channel, index in self._container.index(chunk).items():
                if topic := new.get(channel):
                    assert topic.signal is not None
                    check_room(len(index) * (2 + topic.signal.width), self._container)
                    samples = Samples(len(index), topic.signal.width)
                    topic.read(self._container.unpack(chunk), index, samples)
                    rows[channel].append(
                        [int(f(of)) for of in (samples.stamp, samples.publish) for f in (np.min, np.max)]
                    )
        self._spans |= {channel: np.array(of, np.int64).reshape(-1, 4) for channel, of in rows.items()}

    def _enclose(self, channel: int, start_ns: int, stop_ns: int) -> tuple[int, ...]:
        numbers = self._chunks.get(channel, ())
        if not numbers:
            return ()
        if channel not in self._logged:
            index = (self._container.index(self._container.chunks[number])[channel] for number in numbers)
            self._logged[channel] = np.array([of[0, 0] for of in index], np.uint64).astype(np.int64)
        last = len(numbers) - 1

        def first_ns(i: int) -> int:
            return self._first_ns(channel, numbers[i])

        def guess(t_ns: int) -> int:
            return min(max(int(np.searchsorted(self._logged[channel], t_ns, "right")) - 1, 0), last)

        begin = guess(start_ns)
        while begin > 0 and first_ns(begin) > start_ns:
            begin -= 1
        while begin < last and first_ns(begin + 1) <= start_ns:
            begin += 1
        end = max(guess(stop_ns), begin)
        while end < last and first_ns(end + 1) < stop_ns:
            end += 1
        while end > begin and first_ns(end) >= stop_ns:
            end -= 1
        return tuple(numbers[begin : end + 1])

    def _first_ns(self, channel: int, number: int) -> int:
        """The first stamp of a channel in a chunk of ours."""
        if (channel, number) not in self._first:
            chunk = self._container.chunks[number]
            data = self._container.peek(chunk)
            for id, index in self._container.index(chunk).items():  # The chunk is open: note what it says of all.
                record = data[int(index[0, 1]) :][_PUBLISH].tobytes()
                self._first[id, number] = int.from_bytes(record, "little", signed=True)
        return self._first[channel, number]
