"""The structure of an MCAP file: its records, checked, without a look into the messages."""

import mmap
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from isal.isal_zlib import crc32
from jaxtyping import UInt8, UInt64
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, DataEnd, Footer, Metadata, Schema, Statistics
from mcap.writer import MCAP0_MAGIC as MAGIC

from wrenchflow import messages
from wrenchflow.errors import RecordingError
from wrenchflow.recording.compression import MAX_CHUNK_BYTES, decompress

_PREFIX = struct.Struct("<BQ")
_CHUNK = struct.Struct("<QQQI")
_FOOTER_SIZE = _PREFIX.size + 20


@dataclass
class Chunk:
    """Where one chunk's bytes lie, and where its messages lie in them.

    Attributes:
        data: The bytes as they are stored.
        compression: `zstd`, `lz4` or empty.
        size: Length of the uncompressed bytes.
        crc: CRC-32 of the uncompressed bytes, or 0 if it was not computed.
        index: Log time [ns] and offset of each message by channel id; empty in files without an index. Shape (n, 2).
        is_checked: Whether the bytes were found to be what `size` and `crc` say.
    """

    data: memoryview
    compression: str
    size: int
    crc: int
    index: dict[int, UInt64[np.ndarray, "n 2"]] = field(default_factory=dict)
    is_checked: bool = False


class Container:
    """An MCAP file that is whole: its ends, its structure and its summary's checksum were looked at.

    A chunk's checksum is looked at when the chunk is, and that over all data when `check` is called.

    Attributes:
        path: The file.
        size: Its length in bytes.
        schemas: By id.
        channels: By id.
        statistics: From the summary, if there is one.
        chunks: In the order of the file. Messages outside chunks are one more chunk, without compression.
        metadata: Metadata records by name; of several, the last.
        attachments: Files by name; of several, the last.
    """

    def __init__(self, path: Path) -> None:
        """Open a file and read its structure; chunks stay compressed.

        Args:
            path: An MCAP file.

        Raises:
            RecordingError: If the file is missing, unfinished, truncated, damaged or not MCAP.
        """
        self.path = path
        self._bytes = _open(path)
        self.size = len(self._bytes)
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self.statistics: Statistics | None = None
        self.chunks: list[Chunk] = []
        self.metadata: dict[str, dict[str, str]] = {}
        self.attachments: dict[str, messages.Attachment] = {}
        self._data_end, self._data_crc = 0, 0
        self._last: tuple[Chunk, UInt8[np.ndarray, " n"]] | None = None  # The chunk that was unpacked last.

        footer_start = self.size - len(MAGIC) - _FOOTER_SIZE
        footer = self._parse(Footer.read, footer_start + _PREFIX.size, self.size - len(MAGIC))
        summary_start = footer.summary_start or footer_start
        if not len(MAGIC) <= summary_start <= footer_start:
            raise self.damaged("its footer points outside the file")
        if footer.summary_crc and crc32(self._bytes[summary_start : self.size - len(MAGIC) - 4]) != footer.summary_crc:
            raise self.damaged("the checksum of its summary does not match")
        self._read_data(summary_start)
        self._read_summary(summary_start, footer_start)

    def damaged(self, why: str) -> RecordingError:
        """The error that says that this file is damaged, and why."""
        return RecordingError(f"{self.path} is damaged: {why}.")

    def schema_name(self, channel: int) -> str:
        """The message type of a channel; empty where it has none."""
        schema = self.schemas.get(self.channels[channel].schema_id)
        return schema.name if schema else ""

    def _parse[T](self, read: Callable[[ReadDataStream], T], start: int, stop: int) -> T:
        try:
            return read(ReadDataStream(BytesIO(self._bytes[start:stop])))
        except (struct.error, McapError, UnicodeDecodeError) as error:
            raise self.damaged(f"its record at byte {start} cannot be read") from error

    def _records(self, data: memoryview | bytes, start: int, stop: int) -> Iterator[tuple[int, int, int]]:
        """Opcode, and start and stop of the content, of each record between two places."""
        while start < stop:
            if start + _PREFIX.size > stop:
                raise self.damaged(f"a record at byte {start} is cut off")
            opcode, length = _PREFIX.unpack_from(data, start)
            start += _PREFIX.size
            if start + length > stop:
                raise self.damaged(f"a record at byte {start} runs past its end")
            yield opcode, start, start + length
            start += length

    def _read_data(self, stop: int) -> None:
        loose = False
        for opcode, start, end in self._records(self._bytes, len(MAGIC), stop):
            if self._data_end:
                raise self.damaged("records follow the end of its data")
            match opcode:
                case Opcode.CHUNK:
                    self.chunks.append(self._read_chunk(start, end))
                case Opcode.MESSAGE_INDEX:
                    self._read_index(start, end)
                case Opcode.SCHEMA | Opcode.CHANNEL:
                    self._add_definition(opcode, self._bytes, start, end)
                case Opcode.METADATA:
                    record = self._parse(Metadata.read, start, end)
                    self.metadata[record.name] = record.metadata
                case Opcode.ATTACHMENT:
                    try:
                        name, attached = read_attachment(self._bytes[start:end])
                    except (struct.error, McapError, ValueError) as error:
                        raise self.damaged(f"its attachment at byte {start} cannot be read") from error
                    self.attachments[name] = attached
                case Opcode.MESSAGE:
                    loose = True
                case Opcode.DATA_END:
                    self._data_end = start - _PREFIX.size
                    self._data_crc = self._parse(DataEnd.read, start, end).data_section_crc
        if not self._data_end:
            raise self.damaged("its data has no end record")
        if loose:
            data = self._bytes[len(MAGIC) : self._data_end]
            self.chunks.append(Chunk(data, "", len(data), 0))

    def _read_chunk(self, start: int, end: int) -> Chunk:
        _, _, size, crc = self._unpack(_CHUNK, start, end)
        at = start + _CHUNK.size
        (length,) = self._unpack(struct.Struct("<I"), at, end)
        compression = bytes(self._bytes[at + 4 : at + 4 + length]).decode(errors="replace")
        at += 4 + length
        (length,) = self._unpack(struct.Struct("<Q"), at, end)
        return Chunk(self._bytes[at + 8 : min(at + 8 + length, end)], compression, size, crc)

    def _read_index(self, start: int, end: int) -> None:
        channel, length = self._unpack(struct.Struct("<HI"), start, end)
        if not self.chunks or length % 16 or start + 6 + length > end:
            raise self.damaged(f"its message index at byte {start} cannot be read")
        if length:
            index = np.frombuffer(self._bytes, "<u8", length // 8, start + 6)
            self.chunks[-1].index[channel] = index.reshape(-1, 2)

    def _unpack(self, layout: struct.Struct, start: int, end: int) -> tuple[int, ...]:
        if start + layout.size > end:
            raise self.damaged(f"a record at byte {start} is cut off")
        return layout.unpack_from(self._bytes, start)

    def _add_definition(self, opcode: int, data: memoryview | bytes, start: int, end: int) -> None:
        stream = ReadDataStream(BytesIO(data[start:end]))
        try:
            record = Schema.read(stream) if opcode == Opcode.SCHEMA else Channel.read(stream)
        except (struct.error, McapError, UnicodeDecodeError) as error:
            raise self.damaged(f"its schema or channel at byte {start} cannot be read") from error
        known: dict[int, Any] = self.schemas if isinstance(record, Schema) else self.channels
        if known.setdefault(record.id, record) != record:
            raise self.damaged(f"{type(record).__name__.lower()} {record.id} is defined twice, as different things")

    def _read_summary(self, start: int, stop: int) -> None:
        for opcode, first, last in self._records(self._bytes, start, stop):
            match opcode:
                case Opcode.SCHEMA | Opcode.CHANNEL:
                    self._add_definition(opcode, self._bytes, first, last)
                case Opcode.STATISTICS:
                    self.statistics = self._parse(Statistics.read, first, last)

    def check(self) -> None:
        """Look at the checksum over all data, for which every byte of the file is read.

        Raises:
            RecordingError: If it does not match.
        """
        if self._data_crc and crc32(self._bytes[: self._data_end]) != self._data_crc:
            raise self.damaged("the checksum of its data does not match")
        self._data_crc = 0

    def unpack(self, chunk: Chunk) -> UInt8[np.ndarray, " n"]:
        """The uncompressed bytes of a chunk; the last one that was asked for is kept.

        Raises:
            RecordingError: If the bytes do not decompress to what the chunk says that they are.
        """
        if self._last is not None and self._last[0] is chunk:
            return self._last[1]
        self._last = None  # Two chunks at once may take twice as much memory as there is.
        if chunk.size > MAX_CHUNK_BYTES and chunk.compression:
            raise self.damaged(f"a chunk claims {chunk.size} bytes, where {MAX_CHUNK_BYTES} are the most")
        try:
            content = decompress(chunk.data, chunk.compression, chunk.size)
        except RecordingError as error:
            raise RecordingError(f"{self.path}: {error}") from error
        is_right = chunk.is_checked or not chunk.crc or crc32(content) == chunk.crc
        if len(content) != chunk.size or not is_right:
            raise self.damaged("the checksum of a chunk does not match")
        chunk.is_checked = True
        data = np.frombuffer(content, np.uint8)
        self._last = chunk, data
        return data

    def peek(self, chunk: Chunk) -> UInt8[np.ndarray, " n"]:
        """The same, but of a chunk that is not compressed only those bytes are read that are looked at."""
        return self.unpack(chunk) if chunk.compression else np.frombuffer(chunk.data, np.uint8)

    def walk(self, chunk: Chunk) -> dict[int, UInt64[np.ndarray, "n 2"]]:
        """The index that a chunk's messages themselves make up, whatever the file states."""
        from wrenchflow.recording.records import count_records, index_records, words_of

        data = self.unpack(chunk)
        counts = np.zeros(2**16, np.int64)
        n_others, cut_at = count_records(data, words_of(data), counts)
        if cut_at >= 0:
            raise self.damaged(f"a record at byte {cut_at} of a chunk is cut off")
        n_messages = int(counts.sum())
        # Every message has a time of its own; so many that take so little are not worth the memory for their index.
        if n_messages + n_others > len(chunk.data):
            raise self.damaged(f"a chunk of {len(chunk.data)} bytes claims {n_messages} messages")
        index, others = np.empty((n_messages, 2), np.uint64), np.empty(n_others, np.int64)
        index_records(data, words_of(data), np.cumsum(counts) - counts, index, others)
        for at in others.tolist():
            ((opcode, start, end),) = self._records(data.data, at, self._stop(data, at))
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._add_definition(opcode, data.data, start, end)
        found = np.flatnonzero(counts)
        if not set(found.tolist()) <= self.channels.keys():
            raise self.damaged("a chunk has messages of a channel that it does not describe")
        parts = np.split(index, np.cumsum(counts[found])[:-1])
        return {int(channel): part for channel, part in zip(found, parts, strict=False)}

    def _stop(self, data: UInt8[np.ndarray, " n"], at: int) -> int:
        return at + _PREFIX.size + _PREFIX.unpack_from(data, at)[1]

    def index(self, chunk: Chunk) -> dict[int, UInt64[np.ndarray, "n 2"]]:
        """Log time [ns] and offset of each message of a chunk by channel id, without decompression if possible."""
        if not chunk.index or not chunk.index.keys() <= self.channels.keys():
            chunk.index = self.walk(chunk)
        return chunk.index


def read_attachment(content: memoryview) -> tuple[str, messages.Attachment]:
    """Name and content of an attachment record.

    Raises:
        ValueError: If its checksum does not match; it may also raise what `mcap` and `struct` raise.
    """
    (crc,) = struct.unpack_from("<I", content, len(content) - 4)
    if crc and crc32(content[:-4]) != crc:
        raise ValueError("the checksum of an attachment does not match")
    try:
        record = Attachment.read(ReadDataStream(BytesIO(content)))
    except OverflowError as error:
        raise ValueError("an attachment claims more bytes than there can be") from error
    return record.name, messages.Attachment(
        data=record.data,
        media_type=record.media_type,
        log_time_ns=record.log_time,
        create_time_ns=record.create_time,
    )


def map_file(path: Path) -> memoryview:
    """The bytes of a file, without reading them yet.

    Raises:
        RecordingError: If it cannot be opened.
    """
    try:
        with path.open("rb") as file:
            size = path.stat().st_size
            return memoryview(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)) if size else memoryview(b"")
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {(error.strerror or str(error)).lower()}.") from error


def _open(path: Path) -> memoryview:
    """The bytes of a file that begins and ends as an MCAP file does."""
    if path.suffix in (".partial", ".rows"):
        raise RecordingError(
            f"{path} is an unfinished recording: it is being written, or was interrupted. "
            f"`wrenchflow recover {path}` saves what it holds."
        )
    data = map_file(path)
    if not MAGIC.startswith(bytes(data[: len(MAGIC)])):
        raise RecordingError(f"{path} is not an MCAP file: it starts with {bytes(data[:8]).hex()}.")
    footer = data[-len(MAGIC) - _FOOTER_SIZE : -len(MAGIC)]
    is_footer = footer[: _PREFIX.size] == _PREFIX.pack(Opcode.FOOTER, _FOOTER_SIZE - _PREFIX.size)
    if data[-len(MAGIC) :] != MAGIC or len(data) < 2 * len(MAGIC) + _FOOTER_SIZE or not is_footer:
        raise RecordingError(f"{path} is truncated: its end is missing (it has {len(data)} bytes).")
    return data
