"""The summary at the end of an MCAP file, as far as it can be believed: what is had from it if the data are damaged."""

import struct
from dataclasses import dataclass, field
from io import BytesIO

from isal.isal_zlib import crc32
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import AttachmentIndex, Channel, ChunkIndex, MetadataIndex, Schema
from mcap.writer import MCAP0_MAGIC as MAGIC

_PREFIX, _FOOTER, _CRC = struct.Struct("<BQ"), struct.Struct("<QQI"), struct.Struct("<I")
_READ = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.ATTACHMENT_INDEX: AttachmentIndex,
    Opcode.METADATA_INDEX: MetadataIndex,
}


@dataclass(frozen=True)
class Summary:
    """What the end of a file says.

    Attributes:
        problem: What is wrong with it, in words; empty if nothing is.
        schemas: By id.
        channels: By id.
        lengths: Bytes of each chunk, attachment and metadata record, by where it begins.
        is_vouched: Whether a checksum vouches for it all.
    """

    problem: str = ""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    lengths: dict[int, int] = field(default_factory=dict)
    is_vouched: bool = False


def read_summary(data: memoryview) -> Summary:
    """Read the summary of a file, whatever became of the rest.

    Args:
        data: The whole file.
    """
    end = len(data) - len(MAGIC)
    footer = end - _PREFIX.size - _FOOTER.size
    is_footer = footer >= len(MAGIC) and _PREFIX.unpack_from(data, footer) == (Opcode.FOOTER, _FOOTER.size)
    if data[end:] != MAGIC or not is_footer:
        return Summary("its summary is cut off")
    start, _, crc = _FOOTER.unpack_from(data, footer + _PREFIX.size)
    start = start or footer
    if start > footer or (crc and crc32(data[start : end - _CRC.size]) != crc):
        return Summary("the checksum of its summary does not match")
    found = Summary(is_vouched=bool(crc))
    try:
        while start + _PREFIX.size <= footer:
            opcode, length = _PREFIX.unpack_from(data, start)
            start += _PREFIX.size + length
            if opcode in _READ:
                record = _READ[opcode].read(ReadDataStream(BytesIO(data[start - length : min(start, footer)])))
                match record:
                    case Schema():
                        found.schemas[record.id] = record
                    case Channel():
                        found.channels[record.id] = record
                    case ChunkIndex():
                        found.lengths[record.chunk_start_offset] = record.chunk_length
                    case AttachmentIndex() | MetadataIndex():
                        found.lengths[record.offset] = record.length
    except (struct.error, McapError, ValueError):
        return Summary("its summary cannot be read")
    return found
