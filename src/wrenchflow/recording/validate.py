"""Looks at every byte of a recording, and says all that is wrong with it."""

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.writer import MCAP0_MAGIC as MAGIC

from wrenchflow.episode import Stream
from wrenchflow.errors import RecordingError
from wrenchflow.recording.container import Container, map_file
from wrenchflow.recording.file_format import RESULT
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.summary import read_summary

_PREFIX = struct.Struct("<BQ")
_GAP = 1.5  # Two samples that are further apart than this many periods have a gap between them.


@dataclass(frozen=True, kw_only=True)
class StreamReport:
    """How regular a stream is.

    Attributes:
        samples: How many.
        period_s: Median time between them [s]; None for fewer than two.
        gaps: Times between samples of more than one and a half periods.
        longest_gap_s: The longest of them [s]; 0 without one.
        jitter_s: Standard deviation of the time between samples, gaps left out [s].
        not_finite: Values that are NaN or infinite.
    """

    samples: int
    period_s: float | None
    gaps: int
    longest_gap_s: float
    jitter_s: float
    not_finite: int


@dataclass(frozen=True, kw_only=True)
class Validation:
    """What was found in a file.

    Attributes:
        problems: What a tool would stumble over, or what is not as the file says; empty for a valid file.
        streams: How regular each stream is, by name; empty where the file cannot be read.
    """

    problems: tuple[str, ...]
    streams: dict[str, StreamReport]


def validate(path: Path) -> Validation:
    """Check structure, checksums, indices, counts and streams of a recording.

    Raises:
        RecordingError: If there is no such file, or it cannot be opened.
    """
    if not path.is_file():
        raise RecordingError(f"recording '{path}' does not exist.")
    try:
        container = Container(path)
        container.check()
        problems = [*_chunks(container), *_counts(container), *_places(path)]
        episode = read_episode(path)
    except RecordingError as error:
        return Validation(problems=(str(error),), streams={})
    streams = {name: _regularity(stream) for name, stream in episode.streams.items()}
    return Validation(problems=tuple(problems), streams=streams)


def _chunks(container: Container) -> Iterator[str]:
    """Chunks whose index is not that of their messages."""
    for number, chunk in enumerate(container.chunks):
        stated = dict(chunk.index)
        container.unpack(chunk)
        if stated:
            found = container.walk(chunk)
            if found.keys() != stated.keys():
                yield f"the index of chunk {number} is of channels {sorted(stated)}, its messages of {sorted(found)}"
            elif any(not np.array_equal(_sorted(found[id]), _sorted(stated[id])) for id in found):
                yield f"the index of chunk {number} does not lead to its messages"


def _sorted(index: np.ndarray) -> np.ndarray:
    return index[np.lexsort(index.T[::-1])]


def _counts(container: Container) -> Iterator[str]:
    """Counts that the summary or our closing record states, and that are not so."""
    counts: dict[int, int] = {}
    for chunk in container.chunks:
        for id, index in container.index(chunk).items():
            counts[id] = counts.get(id, 0) + len(index)
    if container.statistics is not None:
        if container.statistics.message_count != sum(counts.values()):
            yield f"it has {sum(counts.values())} messages, and its summary states {container.statistics.message_count}"
        for id, stated in container.statistics.channel_message_counts.items():
            if counts.get(id, 0) != stated:
                yield f"channel {id} has {counts.get(id, 0)} messages, and its summary states {stated}"
    try:
        stated_by_topic = dict(json.loads(container.metadata.get(RESULT, {}).get("message_counts", "{}")))
    except (TypeError, ValueError) as error:
        yield f"its closing record's message counts cannot be read ({error})"
        return
    topics = {channel.topic: id for id, channel in container.channels.items()}
    for topic, stated in stated_by_topic.items():
        got = counts.get(topics.get(topic, -1), 0)
        if got != stated:
            yield f"'{topic}' has {got} messages, and its closing record states {stated}"


def _places(path: Path) -> Iterator[str]:
    """Places of chunks, attachments and metadata that the summary states, and where none of them is."""
    data, at, found = map_file(path), len(MAGIC), {}
    while at + _PREFIX.size <= len(data):
        _, length = _PREFIX.unpack_from(data, at)
        found[at] = _PREFIX.size + length
        at += found[at]
    summary = read_summary(data)
    if summary.problem:
        yield summary.problem
    for start, length in summary.lengths.items():
        if found.get(start) != length:
            yield f"its summary leads to {length} bytes from byte {start} on, which are no record"


def _regularity(stream: Stream) -> StreamReport:
    between_ns = np.diff(stream.t)
    period_ns = float(np.median(between_ns)) if len(between_ns) else None
    is_gap = between_ns > _GAP * (period_ns or 0.0)
    regular = between_ns[~is_gap]
    return StreamReport(
        samples=len(stream),
        period_s=None if period_ns is None else period_ns * 1e-9,
        gaps=int(is_gap.sum()),
        longest_gap_s=float(between_ns[is_gap].max(initial=0)) * 1e-9,
        jitter_s=float(regular.std()) * 1e-9 if len(regular) else 0.0,
        not_finite=int((~np.isfinite(stream.data)).sum()),
    )
