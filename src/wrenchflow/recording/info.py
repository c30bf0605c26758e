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
        gaps: Pauses of more than one and a half times the median period; None for fewer than three messages.
        longest_pause_s: The longest time between two messages [s]; None for fewer than two.
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
        topics: In the order of their names.
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
    times = {id: np.sort(np.concatenate(of)) for id, of in parts.items()}
    topics = [
        _topic(channel.topic, container.schema_name(id), times.get(id, np.empty(0, np.uint64)))
        for id, channel in container.channels.items()
    ]
    start_ns = min((int(t[0]) for t in times.values()), default=0)
    stop_ns = max((int(t[-1]) for t in times.values()), default=0)
    attachments = {
        name: AttachmentInfo(size_bytes=len(attached.data), media_type=attached.media_type)
        for name, attached in container.attachments.items()
    }
    return RecordingInfo(
        id=head.id,
        task=head.task,
        meta=head.meta,
        topics=tuple(sorted(topics, key=lambda topic: topic.name)),
        duration_s=(stop_ns - start_ns) * 1e-9,
        size_bytes=container.size,
        chunks=dict(Counter(chunk.compression or "none" for chunk in container.chunks)),
        attachments=attachments,
    )


def _topic(name: str, schema: str, t: UInt64[np.ndarray, " n"]) -> TopicInfo:
    between_ns = np.diff(t)
    start_ns, stop_ns = (int(t[0]), int(t[-1])) if len(t) else (None, None)
    span_ns = int(between_ns.sum())
    return TopicInfo(
        name=name,
        schema=schema,
        count=len(t),
        rate_hz=len(between_ns) / span_ns * 1e9 if span_ns else None,
        start_ns=start_ns,
        stop_ns=stop_ns,
        gaps=int((between_ns > _GAP * np.median(between_ns)).sum()) if len(t) > 2 else None,
        longest_pause_s=float(between_ns.max()) * 1e-9 if len(t) > 1 else None,
    )
