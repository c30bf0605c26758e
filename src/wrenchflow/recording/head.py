"""What our metadata records say of a file, or in another writer's file its name; chunks stay closed."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from wrenchflow.errors import RecordingError, StreamError
from wrenchflow.recording import schemas
from wrenchflow.recording.container import Container
from wrenchflow.recording.file_format import CLOSING, FORMAT_VERSION, META_PREFIX, METADATA, RESULT, signal_of
from wrenchflow.signals import Signal


@dataclass(frozen=True)
class Head:
    """What a file says of itself.

    Attributes:
        id: Name of the episode; of another writer's file, its own name.
        task: The task that was attempted; empty in files of other writers.
        meta: JSON values.
        streams: Signal and frame of each stream, in their order.
        is_ours: Whether wrenchflow wrote it. Then the stamps of a stream increase from chunk to chunk.
    """

    id: str
    task: str = ""
    meta: Mapping[str, Any] = field(default_factory=dict)
    streams: Mapping[str, tuple[Signal, str]] = field(default_factory=dict)
    is_ours: bool = False


def read_head(container: Container) -> Head:
    """Read the metadata records.

    Raises:
        RecordingError: If they are damaged, or of a newer version.
    """
    if METADATA not in container.metadata:
        return Head(container.path.stem)
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
        meta |= {key: json.loads(result[key]) for key in CLOSING if key in result}
        streams = {name: (signal_of(of), of["frame"]) for name, of in json.loads(entries["streams"]).items()}
        for signal, _ in streams.values():
            schemas.message_of(signal)  # Says so if no message can carry it.
        return Head(entries["id"], entries["task"], meta, streams, is_ours=True)
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError, StreamError) as error:
        raise container.damaged(f"its '{METADATA}' metadata cannot be read ({error})") from error
