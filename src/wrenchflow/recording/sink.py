"""The writing end of an MCAP file: records, chunks, checksums and summary; `.partial` until it is complete."""

import fcntl
import os
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from isal.isal_zlib import crc32
from jaxtyping import UInt8, UInt64
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC as MAGIC

from wrenchflow import __version__, messages
from wrenchflow.errors import OutputError
from wrenchflow.recording.compression import compressor


class Sink:
    """An MCAP file that is being written.

    Nothing in it depends on when or where it was written. Until `finish`, the file is `<path>.partial`; one that an
    interrupted run left behind is replaced.
    """

    def __init__(self, path: Path, compression: str = "zstd", *, profile: str = "ros2", library: str = "") -> None:
        """Start the file.

        Args:
            path: The final name.
            compression: One of `compression.NAMES`.
            profile: What its header says that the messages are.
            library: What its header says that wrote it; empty for us.

        Raises:
            OutputError: If the path is taken, or its folder cannot be written to.
        """
        if path.exists():
            raise OutputError(f"{path} exists already, and a recording is never overwritten.")
        self._path = path
        self._partial = path.with_name(path.name + ".partial")
        self._offset = 0
        self._crc = 0
        self._definitions: list[Schema | Channel] = []
        self._metadata: list[MetadataIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._chunks = bytearray()  # Their index records as bytes: a long recording has many.
        self._n_chunks, self._start_ns, self._stop_ns = 0, 0, 0
        self._counts: dict[int, int] = {}
        self._compression, self._compress = compression, compressor(compression)
        try:
            self._file = self._partial.open("wb")
            fcntl.flock(self._file, fcntl.LOCK_SH)  # As long as we live: `recover` then knows better than to touch it.
        except OSError as error:
            raise self._cannot_write(error) from error
        self._append(MAGIC)
        self._append(_bytes(Header(profile=profile, library=library or f"wrenchflow {__version__}")))

    def define(self, record: Schema | Channel) -> None:
        """Add a schema or a channel, outside of the chunks, so that a file cut short still has it."""
        self._definitions.append(record)
        self._append(_bytes(record))

    def add_metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Add a metadata record."""
        content = _bytes(Metadata(name=name, metadata=dict(entries)))
        self._metadata.append(MetadataIndex(offset=self._offset, length=len(content), name=name))
        self._append(content)

    def add_attachment(self, name: str, attached: messages.Attachment) -> None:
        """Add a file."""
        record = Attachment(
            create_time=attached.create_time_ns,
            log_time=attached.log_time_ns,
            name=name,
            media_type=attached.media_type,
            data=attached.data,
        )
        content = _bytes(record)
        self._attachments.append(
            AttachmentIndex(
                offset=self._offset,
                length=len(content),
                log_time=record.log_time,
                create_time=record.create_time,
                data_size=len(record.data),
                name=record.name,
                media_type=record.media_type,
            )
        )
        self._append(content)
        self._flush()

    def add_chunk(
        self,
        records: UInt8[np.ndarray, " size"],
        index: Mapping[int, UInt64[np.ndarray, "n 2"]],
        compression: str | None = None,
    ) -> None:
        """Compress and add a chunk, and hand it to the operating system.

        Args:
            records: Message records.
            index: Log time [ns] and offset in `records` of each message, by channel id. Shape (n, 2).
            compression: Other than the file's.
        """
        content = memoryview(records)
        compress = self._compress if compression is None else compressor(compression)
        chosen = compression or self._compression
        self.copy_chunk(compress(content), chosen, len(records), crc32(records), index)

    def copy_chunk(
        self,
        compressed: bytes | memoryview,
        compression: str,
        size: int,
        crc: int,
        index: Mapping[int, UInt64[np.ndarray, "n 2"]],
    ) -> None:
        """Add a chunk that is compressed already.

        Args:
            compressed: Its bytes.
            compression: How they are; `none` for not at all.
            size: Bytes when uncompressed.
            crc: CRC-32 of those, or 0.
            index: As of `add_chunk`.
        """
        start_ns = min(int(rows[:, 0].min()) for rows in index.values())
        stop_ns = max(int(rows[:, 0].max()) for rows in index.values())
        label = b"" if compression == "none" else compression.encode()
        head = struct.pack("<QQQI", start_ns, stop_ns, size, crc)
        head += struct.pack("<I", len(label)) + label + struct.pack("<Q", len(compressed))
        chunk_offset = self._offset
        self._append(struct.pack("<BQ", Opcode.CHUNK, len(head) + len(compressed)) + head)
        self._append(compressed)
        index_offset = self._offset
        index_records = bytearray()
        offsets = {}
        for channel, rows in index.items():
            offsets[channel] = index_offset + len(index_records)
            index_records += struct.pack("<BQHI", Opcode.MESSAGE_INDEX, 6 + rows.nbytes, channel, rows.nbytes)
            index_records += rows.astype("<u8", copy=False).tobytes()
            self._counts[channel] = self._counts.get(channel, 0) + len(rows)
        self._append(index_records)
        self._chunks += _bytes(
            ChunkIndex(
                chunk_length=index_offset - chunk_offset,
                chunk_start_offset=chunk_offset,
                compression=label.decode(),
                compressed_size=len(compressed),
                message_end_time=stop_ns,
                message_index_length=self._offset - index_offset,
                message_index_offsets=offsets,
                message_start_time=start_ns,
                uncompressed_size=size,
            )
        )
        self._start_ns = start_ns if not self._n_chunks else min(self._start_ns, start_ns)
        self._stop_ns = max(self._stop_ns, stop_ns)
        self._n_chunks += 1
        # What Python still buffers would be lost with the process.
        self._flush()

    def sync(self) -> None:
        """Make sure that what was added so far survives a loss of power; may take tens of milliseconds."""
        self._flush()
        try:
            os.fdatasync(self._file.fileno())
        except OSError as error:
            raise self._cannot_write(error) from error

    def finish(self) -> None:
        """Add the summary, make sure that it is on the disk, and give the file its final name."""
        self._append(_bytes(DataEnd(data_section_crc=self._crc)))
        start = self._offset
        content = bytearray()
        groups = []
        for opcode, records in self._summary():
            if records:
                groups.append(SummaryOffset(opcode, start + len(content), len(records)))
                content += records
        offsets_start = start + len(content)
        content += b"".join(map(_bytes, groups))
        # The checksum covers the footer up to itself.
        content += _bytes(Footer(summary_start=start, summary_offset_start=offsets_start, summary_crc=0))[:-4]
        self._append(bytes(content) + struct.pack("<I", crc32(content)) + MAGIC)
        self._flush()
        try:
            os.fsync(self._file.fileno())
            self._file.close()
            self._partial.rename(self._path)
            folder = os.open(self._path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
        except OSError as error:
            raise self._cannot_write(error) from error

    def close(self) -> None:
        """Let go of the file; unless it was finished, it stays as `.partial` with what it holds."""
        try:
            self._file.close()
        except OSError as error:
            raise self._cannot_write(error) from error

    def _summary(self) -> Iterator[tuple[Opcode, bytes | bytearray]]:
        """The records of the summary, by kind."""
        schemas = [record for record in self._definitions if isinstance(record, Schema)]
        channels = [record for record in self._definitions if isinstance(record, Channel)]
        statistics = Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(channels),
            channel_message_counts={channel.id: self._counts.get(channel.id, 0) for channel in channels},
            chunk_count=self._n_chunks,
            message_count=sum(self._counts.values()),
            message_end_time=self._stop_ns,
            message_start_time=self._start_ns,
            metadata_count=len(self._metadata),
            schema_count=len(schemas),
        )
        yield Opcode.SCHEMA, b"".join(map(_bytes, schemas))
        yield Opcode.CHANNEL, b"".join(map(_bytes, channels))
        yield Opcode.STATISTICS, _bytes(statistics)
        yield Opcode.CHUNK_INDEX, self._chunks
        yield Opcode.ATTACHMENT_INDEX, b"".join(map(_bytes, self._attachments))
        yield Opcode.METADATA_INDEX, b"".join(map(_bytes, self._metadata))

    def _flush(self) -> None:
        try:
            self._file.flush()
        except OSError as error:
            raise self._cannot_write(error) from error

    def _append(self, content: bytes | bytearray | memoryview) -> None:
        try:
            self._file.write(content)
        except OSError as error:
            raise self._cannot_write(error) from error
        self._crc = crc32(content, self._crc)
        self._offset += len(content)

    def _cannot_write(self, error: OSError) -> OutputError:
        return OutputError(f"cannot write {self._partial}: {(error.strerror or str(error)).lower()}.")


def _bytes(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()
