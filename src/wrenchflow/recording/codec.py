"""CDR, one message at a time: bytes from named values, and named values with their places from bytes.

`layout` turns the places that `decode` finds in one message into a template for all messages of a topic.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from wrenchflow.errors import RecordingError
from wrenchflow.recording.schemas import FIELDS, short_name

# ROS type -> the code that both `struct` and numpy know it by.
_CODES = {"uint8": "B", "int32": "i", "uint32": "I", "float32": "f", "float64": "d"}
_LITTLE_ENDIAN = b"\x00\x01\x00\x00"
# What holds more numbers than this is no row of a stream, and what claims more may be an enemy.
_MOST_LEAVES = 4096
_ORDERS = {b"\x00\x00": ">", b"\x00\x01": "<"}


@dataclass(frozen=True)
class Leaf:
    """One number or string of a message.

    Attributes:
        offset: Where its value starts in the message, in bytes.
        code: Byte order and type as `struct` and numpy write it, such as `<d`; empty for a string.
        value: What is there.
    """

    offset: int
    code: str
    value: Any


@cache
def _fields(kind: str) -> tuple[tuple[str, str, bool], ...]:
    """Type, name and whether it is a sequence, of each field of a message type."""
    pairs = (field.split() for field in FIELDS[kind])
    return tuple((of.removesuffix("[]"), name, of.endswith("[]")) for of, name in pairs)


class _Encoder:
    """Little-endian CDR in the making."""

    def __init__(self) -> None:
        self.out = bytearray()  # Without the encapsulation header, from whose end CDR aligns.

    def number(self, code: str, value: int | float) -> None:
        self.out.extend(bytes(-len(self.out) % struct.calcsize(code)))
        self.out.extend(struct.pack(f"<{code}", value))

    def put(self, kind: str, value: Any) -> None:
        if kind == "string":
            text = (value or "").encode() + b"\0"
            self.number("I", len(text))
            self.out.extend(text)
        elif kind in _CODES:
            self.number(_CODES[kind], value or 0)
        else:
            for of, name, is_sequence in _fields(kind):
                item = (value or {}).get(name)
                if is_sequence:
                    self.number("I", len(item or ()))
                for element in (item or ()) if is_sequence else (item,):
                    self.put(of, element)


class _Decoder:
    """A place in a CDR message, and what was found before it."""

    def __init__(self, message: str, cdr: bytes, order: str) -> None:
        self.leaves: dict[str, Leaf] = {}
        self._message = message
        self._cdr = cdr
        self._order = order
        self._at = 4

    def number(self, code: str) -> Leaf:
        size = struct.calcsize(code)
        start = self._at + (4 - self._at) % size
        self._at = start + size
        return Leaf(start, self._order + code, struct.unpack_from(self._order + code, self._cdr, start)[0])

    def take(self, path: str, kind: str) -> None:
        if len(self.leaves) == _MOST_LEAVES:
            raise RecordingError(f"a {self._message} has more than {_MOST_LEAVES} values.")
        if kind == "string":
            length = self.number("I").value
            stop = self._at + length
            if stop > len(self._cdr):
                raise RecordingError(f"a {self._message} ends inside its '{path}'.")
            self.leaves[path] = Leaf(self._at, "", self._cdr[self._at : stop].removesuffix(b"\0").decode())
            self._at = stop
        elif kind in _CODES:
            self.leaves[path] = self.number(_CODES[kind])
        else:
            for of, name, is_sequence in _fields(kind):
                inner = f"{path}.{name}" if path else name
                if not is_sequence:
                    self.take(inner, of)
                    continue
                for i in range(
                    self.number("I").value
                ):  # A damaged length runs out of bytes, or of leaves, which raises.
                    self.take(f"{inner}[{i}]", of)


def encode(message: str, values: Mapping[str, Any]) -> bytes:
    """Serialise one message to little-endian CDR with its 4-byte encapsulation header.

    Args:
        message: Full name of the type, such as `std_msgs/msg/String`.
        values: Its fields by name, nested as the type is; what is left out is zero or empty.
    """
    encoder = _Encoder()
    encoder.put(short_name(message), values)
    return _LITTLE_ENDIAN + bytes(encoder.out)


def decode(message: str, cdr: bytes) -> dict[str, Leaf]:
    """Read one CDR message of either byte order.

    Args:
        message: Full name of the type, such as `std_msgs/msg/String`.
        cdr: The message with its 4-byte encapsulation header.

    Returns:
        Every number and string by its path, such as `header.stamp.sec` or `position[0]`.

    Raises:
        RecordingError: If the bytes are not such a message.
    """
    order = _ORDERS.get(cdr[:2])
    if order is None or len(cdr) < 4:
        raise RecordingError(f"a {message} is not plain CDR: it starts with {cdr[:4].hex() or 'nothing'}.")
    decoder = _Decoder(message, cdr, order)
    try:
        decoder.take("", short_name(message))
    except (struct.error, UnicodeDecodeError) as error:
        raise RecordingError(f"a message of {len(cdr)} bytes is not a {message}: {error}.") from error
    return decoder.leaves
