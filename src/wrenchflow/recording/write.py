"""A whole episode to a file at once: each chunk holds all that happened in one window of time."""

from pathlib import Path

import numpy as np

from wrenchflow.episode import Episode
from wrenchflow.recording.file_format import CLOSING
from wrenchflow.recording.pending import CHUNK_BYTES, CHUNK_NS
from wrenchflow.recording.writer import EpisodeWriter

# Cutting a window into equal times does not cut it into equal bytes, so we aim lower than the limit.
_TARGET_BYTES = CHUNK_BYTES * 9 // 10


def write_episode(path: Path, episode: Episode, compression: str = "zstd") -> None:
    """Write a whole episode; what `meta` says of its end goes into the record there. Equal episodes give equal bytes.

    Args:
        path: Where the file goes; until it is complete it is called `<path>.partial`.
        episode: What to write.
        compression: Of the chunks: one of `compression.NAMES`.

    Raises:
        OutputError: If the path is taken or cannot be written.
        StreamError: If a value cannot be represented in the message that carries it.
    """
    meta = dict(episode.meta)
    closing = {key: meta.pop(key) for key in CLOSING if meta.get(key) is not None}
    with EpisodeWriter(
        path,
        id=episode.id,
        task=episode.task,
        meta=meta,
        compression=compression,
        attachments=episode.attachments,
    ) as writer:
        for name, stream in episode.streams.items():
            writer.add_stream(name, stream.signal, stream.frame)
        for name, messages in episode.messages.items():
            writer.add_messages(name, messages.type)
        for name, stream in episode.streams.items():
            writer.check(name, stream)
        _write_windows(writer, episode)
        writer.finish(**closing)


def _write_windows(writer: EpisodeWriter, episode: Episode) -> None:
    """Append everything, window by window; a window that is too large for a chunk is cut into equal times."""
    names = {name: name for name in episode.streams}
    sizes = {name: writer.record_size(name) for name in names}
    moments = {("stream", name): stream.t for name, stream in episode.streams.items() if len(stream)}
    # Messages of other writers may come in any order; a window takes those that were had until its end.
    moments |= {
        ("messages", name): np.maximum.accumulate(messages.t)
        for name, messages in episode.messages.items()
        if len(messages)
    }
    if episode.events:
        moments["events", ""] = np.array([event.start_ns for event in episode.events])
    done = dict.fromkeys(moments, 0)
    while left := [key for key in moments if done[key] < len(moments[key])]:
        start = min(int(moments[key][done[key]]) for key in left)
        stop = min(start + CHUNK_NS, 1 + max(int(moments[key][-1]) for key in left))
        size = sum(
            (int(np.searchsorted(moments[key], stop)) - done[key]) * sizes[key[1]] for key in left if key[0] == "stream"
        )
        pieces = -(-size // _TARGET_BYTES) or 1
        for piece in range(1, pieces + 1):
            edge = start + (stop - start) * piece // pieces
            for key in left:
                kind, name = key
                part = slice(done[key], int(np.searchsorted(moments[key], edge)))
                done[key] = part.stop
                if kind == "events":
                    for event in episode.events[part]:
                        writer.event(event)
                elif kind == "messages":
                    writer.write_messages(name, episode.messages[name].part(part))
                elif part.stop > part.start:
                    stream = episode.streams[name]
                    writer.append(name, stream.t[part], stream.data[part])
            writer.flush()
