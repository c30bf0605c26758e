"""Compressed images as messages, and back; nobody looks into the picture, and reading does not copy it."""

import io
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int64, UInt8

from wrenchflow.clock import SECOND_NS
from wrenchflow.errors import RecordingError
from wrenchflow.messages import Bytes, Messages
from wrenchflow.recording import codec, schemas

PREFIX = "camera/"  # Of the topics of cameras.
_QUALITY = 90  # Of JPEG: a tenth of the bytes, and edges stay where they are.
_LENGTH = struct.Struct("<I")
# In front of the frame's name: the encapsulation, which says that what follows is little-endian, and the stamp.
_HEAD = struct.Struct("<4siI")


@dataclass(frozen=True)
class Image:
    """One compressed image.

    Attributes:
        t_ns: When it was taken [ns].
        frame: The camera's frame.
        format: `jpeg` or `png`.
        data: The compressed picture.
    """

    t_ns: int
    frame: str
    format: str
    data: Bytes


def image_messages(
    t: Int64[np.ndarray, " n"],
    pictures: Sequence[Bytes],
    frame: str,
    *,
    received: Int64[np.ndarray, " n"] | None = None,
    sequence: Int64[np.ndarray, " n"] | None = None,
    format: str = "jpeg",
) -> Messages:
    """Messages that carry pictures.

    Args:
        t: When each was taken [ns]. Shape (n,).
        pictures: Compressed.
        frame: The camera's frame.
        received: When each was had [ns]; without it, when it was taken. Shape (n,).
        sequence: Number of each at the camera; without it they are counted. Shape (n,).
        format: How they are compressed: `jpeg` or `png`.
    """
    payloads = []
    for stamp, picture in zip(t.tolist(), pictures, strict=True):
        seconds, nanoseconds = divmod(stamp, SECOND_NS)
        header = {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame}
        # The sequence of bytes comes last: its length is all that an empty one has.
        empty = codec.encode(schemas.IMAGE_MESSAGE, {"header": header, "format": format})
        payloads.append(empty[:-4] + _LENGTH.pack(len(picture)) + bytes(picture))
    return Messages(
        schemas.message_type(schemas.IMAGE_MESSAGE),
        t,
        t if received is None else received,
        np.arange(len(t)) if sequence is None else sequence,
        tuple(payloads),
    )


def jpeg(pixels: UInt8[np.ndarray, "height width 3"]) -> bytes:
    """A picture as JPEG.

    Args:
        pixels: Red, green, blue. Shape (height, width, 3).
    """
    from PIL import Image as Pillow

    out = io.BytesIO()
    Pillow.fromarray(pixels).save(out, "JPEG", quality=_QUALITY)
    return out.getvalue()


def images_of(messages: Messages) -> Iterator[Image]:
    """The images in messages, one by one.

    Raises:
        RecordingError: If the messages are no images in little-endian CDR.
    """
    if messages.type.name != schemas.IMAGE_MESSAGE or messages.type.encoding != "cdr":
        raise RecordingError(f"'{messages.type.name}' is no image. Images are {schemas.IMAGE_MESSAGE} in CDR.")
    for payload in messages.payloads:
        yield _image(memoryview(payload))


def _image(cdr: memoryview) -> Image:
    try:
        encapsulation, seconds, nanoseconds = _HEAD.unpack_from(cdr)
        if encapsulation[:2] != b"\x00\x01":
            raise RecordingError(f"an image is not little-endian CDR: it starts with {encapsulation.hex()}.")
        frame, at = _string(cdr, _HEAD.size)
        format, at = _string(cdr, at)
        at += -at % 4
        (length,) = _LENGTH.unpack_from(cdr, at)
        if at + 4 + length > len(cdr):
            raise RecordingError(f"an image of {length} bytes does not fit in its message of {len(cdr)} bytes.")
        return Image(seconds * SECOND_NS + nanoseconds, frame, format, cdr[at + 4 : at + 4 + length])
    except (struct.error, UnicodeDecodeError) as error:
        raise RecordingError(f"a message of {len(cdr)} bytes is not a {schemas.IMAGE_MESSAGE}: {error}.") from error


def _string(cdr: memoryview, at: int) -> tuple[str, int]:
    at += -at % 4
    (length,) = _LENGTH.unpack_from(cdr, at)
    if at + 4 + length > len(cdr):
        raise RecordingError(f"a string of {length} bytes does not fit in a message of {len(cdr)} bytes.")
    return bytes(cdr[at + 4 : at + 4 + length]).rstrip(b"\0").decode(), at + 4 + length
