"""The messages of topics that are no streams: when they were, and where their bytes lie."""

from collections.abc import Sequence

import numpy as np

from wrenchflow.errors import RecordingError
from wrenchflow.messages import Messages, MessageType
from wrenchflow.recording.container import Container
from wrenchflow.recording.payloads import Payloads
from wrenchflow.recording.topic import no_message


def messages_of(container: Container, kind: MessageType, channels: Sequence[int], chunks: Sequence[int]) -> Messages:
    """The messages of some channels in the order in which they lie in the file; their bytes stay there.

    Args:
        container: The file.
        kind: Their type.
        channels: Whose.
        chunks: Numbers of the chunks that hold them.

    Raises:
        RecordingError: If an index does not lead to messages of its channel, or a chunk is damaged.
    """
    parts = [_empty(0), *(_of_chunk(container, channels, number) for number in chunks)]
    received, t, sequence, chunk, start, length = (np.concatenate(of) for of in zip(*parts, strict=True))
    return Messages(kind, t, received, sequence, Payloads(container, chunk, start, length))


def _empty(count: int) -> tuple[np.ndarray, ...]:
    return tuple(np.empty(count, np.int64) for _ in range(6))


def _of_chunk(container: Container, channels: Sequence[int], number: int) -> tuple[np.ndarray, ...]:
    from wrenchflow.recording.records import read_headers, words_of

    chunk = container.chunks[number]
    data, index = container.peek(chunk), container.index(chunk)
    parts = []
    for id in channels:
        if id not in index:
            continue
        offsets = index[id][:, 1].astype(np.uint64)
        received, t, sequence, _, start, length = part = _empty(len(offsets))
        found = read_headers(data, words_of(data), offsets, id, received, t, sequence, start, length)
        if found < len(offsets):
            topic = container.channels[id].topic
            error = no_message(int(offsets[found]), id)
            raise RecordingError(f"topic '{topic}' of {container.path} cannot be read: {error}")
        part[3].fill(number)
        parts.append(part)
    together = [np.concatenate(of) for of in zip(*parts, strict=True)]
    order = np.argsort(together[4], kind="stable")
    return tuple(of[order] for of in together)
