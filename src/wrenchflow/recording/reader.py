"""MCAP files to episodes and to summaries: ours bit for bit, and those of other writers as far as their types tell."""

from collections.abc import Collection
from pathlib import Path

from wrenchflow.episode import Episode
from wrenchflow.errors import RecordingError
from wrenchflow.recording.info import RecordingInfo
from wrenchflow.recording.recording import Recording


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


def read_episode(
    path: Path, streams: Collection[str] | None = None, *, messages: Collection[str] | None = None
) -> Episode:
    """Read a recording; `Recording` reads it in parts.

    Args:
        path: A finished MCAP file.
        streams: Names of the streams to read; None reads all. Events and attachments are always read.
        messages: Names of the topics to read that are no streams; None reads all of them where all streams are read,
            else none.

    Returns:
        The episode. The bytes of messages stay in the file until they are asked for.

    Raises:
        RecordingError: If the file is missing, unfinished, damaged or not MCAP, if it lacks one of the names, or if a
            topic is not a stream (its stamps repeat, or its frame changes).
    """
    return Recording(path).read(streams, messages=messages)


def read_info(path: Path) -> RecordingInfo:
    """Read what a recording says about itself; chunks are not decompressed unless they have no index.

    Args:
        path: A finished MCAP file.

    Raises:
        RecordingError: If the file is missing, unfinished, damaged or not MCAP.
    """
    return Recording(path).info
