"""MATLAB's format of versions 5 to 7, as far as arrays of real numbers and structs of them go.

A reader of our own, for the one of scipy takes the whole process down (a segmentation fault) over files with a few
damaged bytes.

Source: MathWorks, *MAT-File Format* (2023), level 5.
"""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from wrenchflow.errors import RecordingError

_HEADER_BYTES, _VERSION, _VERSION_7_3 = 128, 0x0100, 0x0200
_MATRIX, _COMPRESSED = 14, 15
# What the bytes of an element are, by its type.
_STORED = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_STRUCT = 2
_NUMERIC = range(6, 16)
_COMPLEX = 0x0800
# A file may be compressed by this much, and beyond that only as long as it stays small: what is more is an attack.
_MOST_EXPANSION, _FREE_BYTES = 64, 128 * 2**20
_DEEPEST = 2  # A struct array of arrays is all that a mapping can name.


@dataclass(frozen=True, eq=False)
class StructArray:
    """A struct array: the fields of each element, in MATLAB's order; None for a field that holds no real numbers."""

    elements: tuple[dict[str, "Variable"], ...]


Variable = np.ndarray | StructArray | None


class _Element(NamedTuple):
    type: int
    data: memoryview


class _DamageError(Exception):
    """What is wrong with the bytes."""


def read_variables(path: Path) -> dict[str, Variable]:
    """Read the variables of a file.

    Returns:
        Arrays of real numbers, column by column as MATLAB has them; struct arrays; None for all else.

    Raises:
        RecordingError: If it is missing or damaged, or of another version.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise RecordingError(f"file '{path}' does not exist.") from error
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error}") from error
    order = {b"IM": "<", b"MI": ">"}.get(content[126:_HEADER_BYTES])
    if order is None:
        raise RecordingError(f"{path} is no MATLAB file of version 5 to 7.")
    version = int(np.frombuffer(content, f"{order}u2", 1, 124)[0])
    if version == _VERSION_7_3:
        raise RecordingError(f"{path} is of MATLAB 7.3, expected version 5 to 7: save it with '-v7'.")
    if version != _VERSION:
        raise RecordingError(f"{path} is no MATLAB file of version 5 to 7.")
    found: dict[str, Variable] = {}
    room = max(_FREE_BYTES, _MOST_EXPANSION * len(content))
    try:
        for element in _elements(memoryview(content)[_HEADER_BYTES:], order):
            if element.type == _COMPRESSED:
                element = next(_elements(_unpacked(element.data, room), order), None)
            if element is not None and element.type == _MATRIX:
                name, value = _matrix(element.data, order, 1)
                found[name] = value
    except (_DamageError, zlib.error, UnicodeDecodeError) as error:
        raise RecordingError(f"{path} cannot be read as a MATLAB file: {error}") from error
    return found


def _unpacked(data: memoryview, room: int) -> memoryview:
    packed = zlib.decompressobj()
    unpacked = packed.decompress(data, room)
    if not packed.eof:
        raise _DamageError(f"a variable is cut off, or takes more than {room} bytes")
    return memoryview(unpacked)


def _elements(data: memoryview, order: str) -> Iterator[_Element]:
    """The elements that follow each other in some bytes."""
    at = 0
    while at < len(data):
        if len(data) - at < 8:
            raise _DamageError("it ends within a tag")
        kind, size = (int(word) for word in np.frombuffer(data, f"{order}u4", 2, at))
        begin, is_small = at + 8, bool(kind >> 16)
        if is_small:  # Its size, its type and up to four bytes share the eight bytes of a tag.
            kind, size, begin = kind & 0xFFFF, kind >> 16, at + 4
        if size > len(data) - begin or (is_small and size > 4):
            raise _DamageError(f"it ends within an element of {size} bytes")
        yield _Element(kind, data[begin : begin + size])
        # Only what is compressed is not filled up to eight bytes.
        at = at + 8 if is_small else begin + (size if kind == _COMPRESSED else -(-size // 8) * 8)


def _numbers(element: _Element | None, order: str) -> np.ndarray:
    if element is None or element.type not in _STORED:
        raise _DamageError("numbers are missing")
    stored = np.dtype(order + _STORED[element.type])
    if len(element.data) % stored.itemsize:
        raise _DamageError("numbers are cut off")
    return np.frombuffer(element.data, stored)


def _whole(element: _Element | None, order: str) -> np.ndarray:
    numbers = _numbers(element, order)
    if numbers.dtype.kind == "f":
        raise _DamageError("a number that counts is not whole")
    return numbers


def _matrix(data: memoryview, order: str, depth: int) -> tuple[str, Variable]:
    """Name and value of an array."""
    parts = _elements(data, order)
    flags = _whole(next(parts, None), order)
    shape = tuple(int(size) for size in _whole(next(parts, None), order))
    name = _whole(next(parts, None), order).astype(np.uint8).tobytes().decode()
    if not len(flags) or len(shape) < 2 or min(shape) < 0:
        raise _DamageError("an array has no shape")
    kind, count = int(flags[0]) & 0xFF, _product(shape)
    if kind == _STRUCT and depth < _DEEPEST:
        return name, _struct(parts, count, order, depth)
    if kind not in _NUMERIC or int(flags[0]) & _COMPLEX:
        return name, None
    numbers = _numbers(next(parts, None), order) if count else np.empty(0)
    if len(numbers) != count:
        raise _DamageError(f"'{name}' has {len(numbers)} numbers, expected {count}")
    return name, numbers.astype(numbers.dtype.newbyteorder("=")).reshape(shape, order="F")


def _product(shape: tuple[int, ...]) -> int:
    count = 1
    for size in shape:
        count *= size
    return count


def _struct(parts: Iterator[_Element], count: int, order: str, depth: int) -> StructArray:
    length = _whole(next(parts, None), order)
    text = _whole(next(parts, None), order).astype(np.uint8).tobytes()
    if len(length) != 1 or length[0] < 1 or len(text) % int(length[0]):
        raise _DamageError("the names of a struct's fields are missing")
    size = int(length[0])
    names = [text[at : at + size].split(b"\0")[0].decode() for at in range(0, len(text), size)]
    fields = [_matrix(part.data, order, depth + 1)[1] if len(part.data) else None for part in parts]
    if len(fields) != count * len(names):
        raise _DamageError(f"a struct has {len(fields)} values, expected {count} times {len(names)}")
    return StructArray(
        tuple(
            dict(zip(names, fields[at : at + len(names)], strict=True)) for at in range(0, len(fields), len(names) or 1)
        )
    )
