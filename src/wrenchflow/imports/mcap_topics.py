"""The topics of an MCAP file of another writer."""

from pathlib import Path

from wrenchflow.errors import RecordingError, unknown
from wrenchflow.imports.take import TopicRows
from wrenchflow.imports.topics import Topics
from wrenchflow.recording.recording import Recording


class McapTopics(Topics):
    """An MCAP file."""

    def __init__(self, path: Path) -> None:
        """Open it.

        Raises:
            RecordingError: If it is missing, damaged, or no MCAP.
        """
        super().__init__(path.stem, path)
        self._recording = Recording(path)

    def topic(self, name: str, where: str) -> TopicRows:
        """See `Take`."""
        inner, streams = name.removeprefix("/"), self._recording.streams
        if inner in self._recording.messages:
            raise RecordingError(f"{where}: the messages of topic '{name}' of {self._path} are of no type known here.")
        if inner not in streams:
            raise RecordingError(f"{where}: {unknown(f'topic of {self._path}', inner, streams)}")
        rows = self._recording.rows(inner)
        return TopicRows(
            header_ns=rows.stamp, log_ns=rows.publish, data=rows.data, signal=rows.signal, frame=rows.frame
        )
