"""The summary at the end of an MCAP file, as far as it can be believed: definitions, for where others are lost."""

import struct
import zlib
from dataclasses import dataclass, field
from io import BytesIO

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from mcap.writer import MCAP0_MAGIC as MAGIC

_PREFIX, _FOOTER, _CRC = struct.Struct("<BQ"), struct.Struct("<QQI"), struct.Struct("<I")


@dataclass(frozen=True)
class Summary:
    """What the end of a file says.

    Attributes:
        problem: What is wrong with it, in words; empty if nothing is.
        schemas: By id.
        channels: By id.
    """

    problem: str = ""
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)


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
    if start > footer or (crc and zlib.crc32(data[start : end - _CRC.size]) != crc):
        return Summary("the checksum of its summary does not match")
    found = Summary()
    try:
        while start + _PREFIX.size <= footer:
            opcode, length = _PREFIX.unpack_from(data, start)
            start += _PREFIX.size + length
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                stream = ReadDataStream(BytesIO(data[start - length : min(start, footer)]))
                if opcode == Opcode.SCHEMA:
                    schema = Schema.read(stream)
                    found.schemas[schema.id] = schema
                else:
                    channel = Channel.read(stream)
                    found.channels[channel.id] = channel
    except (struct.error, McapError, ValueError):
        return Summary("its summary cannot be read")
    return found
