"""What a recording says about itself, from its structure and the index of its messages alone."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import UInt64

from wrenchflow.recording.container import Container
from wrenchflow.recording.head import Head

_GAP = 1.5  # Two messages that are further apart than this many periods have a gap between them.
_MOST = 0.7  # Of the times between messages, where they come at a rate.


@dataclass(frozen=True, kw_only=True)
class TopicInfo:
    """What a file says about one topic. Its times are those at which the messages were had.

    Attributes:
        name: The topic, with its leading slash.
        schema: Its message type.
        count: Number of messages.
        rate_hz: Mean rate [Hz]; None for fewer than two messages.
        start_ns: Log time of the first message [ns]; None without one.
        stop_ns: Log time of the last message [ns]; None without one.
        gaps: Pauses of more than one and a half times a publisher's median period; None without a period, as of events.
        longest_pause_s: The longest time between two messages of a publisher [s]; None for fewer than two.
    """

    name: str
    schema: str
    count: int
    rate_hz: float | None
    start_ns: int | None
    stop_ns: int | None
    gaps: int | None
    longest_pause_s: float | None


@dataclass(frozen=True, kw_only=True)
class AttachmentInfo:
    """What a file says about a file in it.

    Attributes:
        size_bytes: Its length.
        media_type: Such as `application/json`.
    """

    size_bytes: int
    media_type: str


@dataclass(frozen=True, kw_only=True)
class RecordingInfo:
    """What a file says about itself, without a look into its messages.

    Attributes:
        id: Name of the episode.
        task: The task that was attempted; empty in files of other writers.
        meta: JSON values; empty in files of other writers.
        topics: In the order of their names; one that carries several types is there once for each.
        duration_s: From the first to the last message [s].
        size_bytes: Length of the file.
        chunks: How many chunks there are, by how they are compressed.
        attachments: Files in the file, by name.
    """

    id: str
    task: str
    meta: Mapping[str, Any]
    topics: tuple[TopicInfo, ...]
    duration_s: float
    size_bytes: int
    chunks: Mapping[str, int]
    attachments: Mapping[str, AttachmentInfo]


def info_of(container: Container, head: Head) -> RecordingInfo:
    """What a file says; chunks are decompressed only where they have no index.

    Raises:
        RecordingError: If a chunk without an index is damaged.
    """
    parts: dict[int, list[np.ndarray]] = {}
    for chunk in container.chunks:
        for id, index in container.index(chunk).items():
            parts.setdefault(id, []).append(index[:, 0])
    # Several publishers of a topic have a channel each, and each of them a clock of its own.
    topics: dict[tuple[str, str], list[np.ndarray]] = {}
    for id, channel in container.channels.items():
        times = np.sort(np.concatenate([np.empty(0, np.uint64), *parts.get(id, ())]))
        topics.setdefault((channel.topic, container.schema_name(id)), []).append(times)
    held = [t for of in topics.values() for t in of if len(t)]
    start_ns = min((int(t[0]) for t in held), default=0)
    stop_ns = max((int(t[-1]) for t in held), default=0)
    attachments = {
        name: AttachmentInfo(size_bytes=len(attached.data), media_type=attached.media_type)
        for name, attached in container.attachments.items()
    }
    return RecordingInfo(
        id=head.id,
        task=head.task,
        meta=head.meta,
        topics=tuple(
            _topic(name, schema, of) for (name, schema), of in sorted(topics.items(), key=lambda item: item[0])
        ),
        duration_s=(stop_ns - start_ns) * 1e-9,
        size_bytes=container.size,
        chunks=dict(Counter(chunk.compression or "none" for chunk in container.chunks)),
        attachments=attachments,
    )


def _beats(between_ns: UInt64[np.ndarray, " n"]) -> bool:
    """Whether messages come at a rate, and not when something happens: most are a period apart."""
    periods = between_ns / max(float(np.median(between_ns)), 1.0)
    return float(np.mean(np.abs(periods - 1.0) < _GAP - 1.0)) > _MOST


def _topic(name: str, schema: str, times: list[UInt64[np.ndarray, " n"]]) -> TopicInfo:
    """What the log times of each channel of a topic say, which are in order [ns]."""
    count = sum(map(len, times))
    held = [t for t in times if len(t)]
    start_ns, stop_ns = min((int(t[0]) for t in held), default=None), max((int(t[-1]) for t in held), default=None)
    span_ns = stop_ns - start_ns if start_ns is not None and stop_ns is not None else 0
    between_ns = [np.diff(t) for t in times if len(t) > 1]
    regular = [between for between in between_ns if len(between) > 1 and _beats(between)]
    gaps = [int((between > _GAP * np.median(between)).sum()) for between in regular]
    return TopicInfo(
        name=name,
        schema=schema,
        count=count,
        rate_hz=(count - 1) / span_ns * 1e9 if span_ns else None,
        start_ns=start_ns,
        stop_ns=stop_ns,
        gaps=sum(gaps) if gaps else None,
        longest_pause_s=max((float(between.max()) * 1e-9 for between in between_ns), default=None),
    )
