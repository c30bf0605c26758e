"""Saves what can be saved of an MCAP file that was cut off or damaged, whoever wrote it, or of a file of rows.

The rule: a message is kept if its bytes are known to be whole, and nothing is made up. Whole chunks are copied as they
are, after a look at their checksum; of a chunk that was cut off, every message before the cut is kept; of one whose
bytes were changed, none is. The summary is made anew.
"""

import fcntl
import json
import struct
from bisect import bisect_right
from collections import Counter
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np
from isal.isal_zlib import crc32
from jaxtyping import UInt64
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Schema
from mcap.writer import MCAP0_MAGIC as MAGIC

from wrenchflow.errors import OutputError, RecordingError
from wrenchflow.recording import row_file
from wrenchflow.recording.compression import MAX_CHUNK_BYTES, decompress
from wrenchflow.recording.container import map_file, read_attachment
from wrenchflow.recording.file_format import METADATA, RECOVERED, RESULT, readable
from wrenchflow.recording.layout import HEADER
from wrenchflow.recording.sink import Sink
from wrenchflow.recording.summary import read_summary
from wrenchflow.recording.write import write_episode

_PREFIX = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQII")
_LOOSE_BYTES = 512 * 1024  # Messages outside of chunks are gathered into chunks of this size.
_MESSAGE = struct.Struct("<HIQ")
_CRC = struct.Struct("<I")
_UNREADABLE = (struct.error, McapError, ValueError)


@dataclass(frozen=True, kw_only=True)
class Recovery:
    """What could be saved.

    Attributes:
        messages: How many messages the new file holds.
        chunks: How many chunks of the old one were whole.
        problems: What was wrong, in words; empty for a file that lacked nothing.
    """

    messages: int
    chunks: int
    problems: tuple[str, ...]


def recover(path: Path, out: Path) -> Recovery:
    """Write a whole file with all that can be saved of another, which stays as it is.

    Args:
        path: An MCAP file, whole or not, `.partial` or not; or the rows of an attempt whose process died.
        out: The new file.

    Raises:
        RecordingError: If the file is missing, is not MCAP or is being written right now, or nothing can be saved, not
            even which topics it has.
        OutputError: If `out` is there already, or would take the place of `path`.
    """
    if out.with_name(out.name + ".partial").resolve() == path.resolve():
        raise OutputError(f"output '{out}' is written through '{path.name}', which is to be recovered. Choose another.")
    _require_unwritten(path)
    if path.suffix == row_file.SUFFIX:
        return _recover_rows(path, out)
    data = _open(path)
    salvage = _Salvage(path, data, out)
    try:
        salvage.run()
        return salvage.finish()
    except RecordingError:
        salvage.discard()
        raise
    finally:
        salvage.close()


def _recover_rows(path: Path, out: Path) -> Recovery:
    episode = row_file.read_row_file(path)
    if not episode.streams:
        raise RecordingError(f"nothing of '{path}' can be saved: it holds no row that is whole.")
    write_episode(out, episode)
    messages = sum(map(len, episode.streams.values())) + len(episode.events)
    return Recovery(messages=messages, chunks=0, problems=("what came of the episode is not known",))


class _Message(NamedTuple):
    """Where a message record lies, from its opcode to its last byte."""

    channel: int
    log_time: int
    start: int
    stop: int


class _Salvage:
    """One walk through a file, with what was found and what was wrong."""

    def __init__(self, path: Path, data: memoryview, out: Path) -> None:
        self._path, self._data, self._out = path, data, out
        self._problems: Counter[str] = Counter()
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._summary = read_summary(data)
        self._starts = sorted(self._summary.lengths) if self._summary.is_vouched else []
        self._metadata: set[str] = set()
        self._sink: Sink | None = None
        self._loose: list[memoryview] = []
        self._loose_bytes = 0
        self._messages = self._chunks = 0

    def _sink_of(self) -> Sink:
        """The new file, begun once it is known what the old one's header says."""
        if self._sink is None:
            self._sink = Sink(self._out)
        return self._sink

    def close(self) -> None:
        """Let go of the new file."""
        if self._sink is not None:
            self._sink.close()

    def discard(self) -> None:
        """Leave nothing of the new file behind."""
        if self._sink is not None:
            self._out.with_name(self._out.name + ".partial").unlink(missing_ok=True)

    def run(self) -> None:
        """Read the records of the data section, up to its end or to where they can be followed no more."""
        at = len(MAGIC)
        while True:
            if at + _PREFIX.size > len(self._data):
                self._problems["its end is missing"] += 1
                return
            opcode, length = _PREFIX.unpack_from(self._data, at)
            start, stop = at + _PREFIX.size, at + _PREFIX.size + length
            is_end = opcode in (0, Opcode.DATA_END, Opcode.FOOTER)
            if (other := self._start_within(at, len(self._data) if is_end else stop)) is not None:
                self._problems["a record ends where it cannot"] += 1
                at = other
                continue
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                self._look_at_end(opcode, at, min(stop, len(self._data)))
                return
            if opcode == 0 or stop > len(self._data):
                self._problems["its end is missing" if opcode else f"no record begins at byte {at}"] += 1
                if opcode == Opcode.CHUNK:
                    self._take_chunk(start, len(self._data), is_whole=False)
                return
            self._take(opcode, start, stop)
            at = stop

    def _start_within(self, at: int, stop: int) -> int | None:
        """Where the summary says that another record begins within this one, whose length is wrong then."""
        later = bisect_right(self._starts, at)
        return next((start for start in self._starts[later : later + 1] if start < stop), None)

    def _look_at_end(self, opcode: int, at: int, stop: int) -> None:
        """Say what is wrong with the end of the data and with the summary, which is made anew."""
        content = self._data[at + _PREFIX.size : stop]
        if opcode != Opcode.DATA_END or len(content) != _CRC.size:
            self._problems["its data has no end record"] += 1
        elif (crc := _CRC.unpack(content)[0]) and crc32(self._data[:at]) != crc:
            self._problems["the checksum of its data does not match"] += 1
        if self._summary.problem:
            self._problems[self._summary.problem] += 1

    def _take(self, opcode: int, start: int, stop: int) -> None:
        content = self._data[start:stop]
        if opcode == Opcode.CHUNK:
            self._take_chunk(start, stop, is_whole=True)
        elif opcode == Opcode.MESSAGE:
            self._take_loose(self._data[start - _PREFIX.size : stop])
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.HEADER, Opcode.METADATA, Opcode.ATTACHMENT):
            self._take_record(opcode, content)

    def _take_loose(self, record: memoryview) -> None:
        if len(record) < HEADER.itemsize or not self._knows(_MESSAGE.unpack_from(record, _PREFIX.size)[0]):
            self._problems["a message of a channel that is not described"] += 1
            return
        self._loose.append(record)
        self._loose_bytes += len(record)
        if self._loose_bytes > _LOOSE_BYTES:
            self._add(self._loose)
            self._loose, self._loose_bytes = [], 0

    def _take_record(self, opcode: int, content: memoryview) -> None:
        stream = ReadDataStream(BytesIO(content))
        try:
            if opcode == Opcode.HEADER and self._sink is None:
                header = Header.read(stream)
                self._sink = Sink(self._out, profile=header.profile, library=header.library)
            elif opcode == Opcode.SCHEMA:
                self._define(Schema.read(stream), self._schemas)
            elif opcode == Opcode.CHANNEL:
                self._define(Channel.read(stream), self._channels)
            elif opcode == Opcode.METADATA:
                record = Metadata.read(stream)
                entries = readable(record.name, record.metadata)
                if entries != record.metadata:
                    self._problems[f"metadata '{record.name}' cannot be read" + (" in part" if entries else "")] += 1
                if entries:
                    self._metadata.add(record.name)
                    self._sink_of().add_metadata(record.name, entries)
            elif opcode == Opcode.ATTACHMENT:
                self._sink_of().add_attachment(*read_attachment(content))
        except _UNREADABLE:
            self._problems[f"a {Opcode(opcode).name.lower()} cannot be read"] += 1

    def _define[R: (Schema, Channel)](self, record: R, known: dict[int, R]) -> None:
        kind = type(record).__name__.lower()
        repeated = self._summary.schemas if isinstance(record, Schema) else self._summary.channels
        if self._summary.is_vouched and repeated.get(record.id, record) != record:
            self._problems[f"{kind} {record.id} is not what the summary says, which counts"] += 1
            record = cast(R, repeated[record.id])
        if record.id not in known:
            if isinstance(record, Channel) and record.schema_id and record.schema_id not in self._schemas:
                self._problems[f"channel {record.id} has a schema that is not there"] += 1
                return
            known[record.id] = record
            self._sink_of().define(record)
        elif known[record.id] != record:
            self._problems[f"{kind} {record.id} is defined twice, the first counts"] += 1

    def _knows(self, channel: int) -> bool:
        """Whether a channel is described; if what described it was lost, the summary may repeat it."""
        if channel not in self._channels and channel in self._summary.channels:
            self._problems["what describes a channel is had from the summary"] += 1
            spare = self._summary.channels[channel]
            if spare.schema_id not in self._schemas and spare.schema_id in self._summary.schemas:
                self._define(self._summary.schemas[spare.schema_id], self._schemas)
            self._define(spare, self._channels)
        return channel in self._channels

    def _take_chunk(self, start: int, stop: int, *, is_whole: bool) -> None:
        if start + _CHUNK.size > stop:
            return
        _, _, size, crc, label_size = _CHUNK.unpack_from(self._data, start)
        at = start + _CHUNK.size + label_size + 8
        if at > stop:
            return
        label = bytes(self._data[at - 8 - label_size : at - 8]).decode(errors="replace")
        (length,) = struct.unpack_from("<Q", self._data, at - 8)
        compressed = self._data[at : min(at + length, stop)]
        if size > MAX_CHUNK_BYTES:
            self._problems[f"a chunk claims more than {MAX_CHUNK_BYTES} bytes"] += 1
            return
        try:
            content = memoryview(decompress(compressed, label, size))
        except RecordingError as error:
            self._problems[str(error).rstrip(".")] += 1
            return
        if len(content) == size and crc and crc32(content) != crc:
            self._problems["the checksum of a chunk does not match"] += 1
            return
        messages, is_clean = self._split(content)
        if len(content) == size and is_clean and messages:
            self._sink_of().copy_chunk(compressed, label or "none", size, crc, _index(messages))
            self._messages += len(messages)
            self._chunks += is_whole
        elif is_whole and len(content) < size:
            # Bytes were changed, and nothing tells which: what came out before the decompressor noticed may be wrong.
            self._problems["a chunk cannot be decompressed"] += 1
        else:
            self._add([content[message.start : message.stop] for message in messages])

    def _split(self, content: memoryview) -> tuple[list[_Message], bool]:
        """The messages in a chunk that are whole, and whether there is nothing else in it."""
        messages, at, is_clean = [], 0, True
        while at + _PREFIX.size <= len(content):
            opcode, length = _PREFIX.unpack_from(content, at)
            start, stop = at + _PREFIX.size, at + _PREFIX.size + length
            if stop > len(content):
                break
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._take_record(opcode, content[start:stop])
            elif opcode == Opcode.MESSAGE and stop - at >= HEADER.itemsize:
                channel, _, log_time = _MESSAGE.unpack_from(content, start)
                if self._knows(channel):
                    messages.append(_Message(channel, log_time, at, stop))
                else:
                    is_clean = False
                    self._problems[f"messages of channel {channel}, which is not described"] += 1
            at = stop
        return messages, is_clean and at == len(content)

    def _add(self, records: list[memoryview]) -> None:
        """Add messages as a chunk of their own."""
        content, messages = bytearray(), []
        for record in records:
            channel, _, log_time = _MESSAGE.unpack_from(record, _PREFIX.size)
            messages.append(_Message(channel, log_time, len(content), len(content) + len(record)))
            content += record
        if messages:
            self._sink_of().add_chunk(np.frombuffer(content, np.uint8), _index(messages))
            self._messages += len(messages)

    def finish(self) -> Recovery:
        """Complete the new file."""
        self._add(self._loose)
        if not self._messages and not self._channels:
            raise RecordingError(
                f"nothing of '{self._path}' can be saved: {'; '.join(self._words()) or 'it is empty'}."
            )
        if RESULT not in self._metadata and METADATA in self._metadata:
            self._problems["what came of the episode is not known"] += 1
        entries = {"messages": str(self._messages), "problems": json.dumps("; ".join(self._words()))}
        self._sink_of().add_metadata(RECOVERED, entries)
        self._sink_of().finish()
        return Recovery(messages=self._messages, chunks=self._chunks, problems=tuple(self._words()))

    def _words(self) -> list[str]:
        return [what if count == 1 else f"{what} ({count} times)" for what, count in self._problems.items()]


def _index(messages: list[_Message]) -> dict[int, UInt64[np.ndarray, "n 2"]]:
    rows: dict[int, list[tuple[int, int]]] = {}
    for message in messages:
        rows.setdefault(message.channel, []).append((message.log_time, message.start))
    return {channel: np.array(places, np.uint64) for channel, places in rows.items()}


def _require_unwritten(path: Path) -> None:
    """Refuse a file that somebody is writing: what is missing of it is still to come."""
    try:
        with path.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise RecordingError(f"{path} is being written right now; wait until its recording has ended.") from error
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {(error.strerror or str(error)).lower()}.") from error


def _open(path: Path) -> memoryview:
    data = map_file(path)
    if data[: len(MAGIC)] != MAGIC:
        raise RecordingError(f"{path} is not an MCAP file: it starts with {bytes(data[:8]).hex() or 'nothing'}.")
    return data
