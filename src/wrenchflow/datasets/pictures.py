"""The pictures of a camera at given times: the last one that was taken, compressed as it was recorded."""

import io
from collections.abc import Sequence

import numpy as np
from jaxtyping import Int64, UInt8

from wrenchflow.episode import Episode
from wrenchflow.errors import DatasetError, RecordingError
from wrenchflow.messages import Messages
from wrenchflow.recording.images import PREFIX, images_of
from wrenchflow.recording.info import RecordingInfo


def topic_of(camera: str) -> str:
    """The topic of a camera's pictures."""
    return PREFIX + camera


def cameras_of(info: RecordingInfo) -> tuple[str, ...]:
    """The cameras that a recording has pictures of."""
    names = {topic.name.removeprefix("/") for topic in info.topics}
    return tuple(sorted(name.removeprefix(PREFIX) for name in names if name.startswith(PREFIX)))


def taken(episode: Episode, camera: str) -> Messages:
    """A camera's pictures, in the order in which they were taken.

    Raises:
        DatasetError: If the episode has none, or their stamps do not increase.
    """
    topic = topic_of(camera)
    found = episode.messages.get(topic)
    if found is None or not len(found):
        there = sorted(name.removeprefix(PREFIX) for name in episode.messages if name.startswith(PREFIX))
        raise DatasetError(
            f"there are no pictures of camera '{camera}'. There are those of: {', '.join(there) or 'none'}."
        )
    if (np.diff(found.t) <= 0).any():
        raise DatasetError(f"the stamps of camera '{camera}' do not increase.")
    return found


def pictures_at(messages: Messages, t_ns: Int64[np.ndarray, " T"]) -> list[bytes]:
    """The last picture at or before each time, of which there has to be one; compressed."""
    rows = np.searchsorted(messages.t, t_ns, side="right") - 1
    wanted, inverse = np.unique(rows, return_inverse=True)
    some = Messages(
        messages.type,
        messages.t[wanted],
        messages.received[wanted],
        messages.sequence[wanted],
        tuple(messages.payloads[int(row)] for row in wanted),
    )
    try:
        found = [bytes(image.data) for image in images_of(some)]
    except RecordingError as error:
        raise DatasetError(str(error)) from error
    return [found[i] for i in inverse]


def size_of(picture: bytes) -> tuple[int, int]:
    """Width and height of a compressed picture [pixels].

    Raises:
        DatasetError: If it is no picture.
    """
    from PIL import Image

    try:
        with Image.open(io.BytesIO(picture)) as image:
            return image.size
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        raise DatasetError(f"a picture of {len(picture)} bytes cannot be read: {error}.") from error


def decode(picture: bytes, size_px: tuple[int, int] | None = None) -> UInt8[np.ndarray, "height width 3"]:
    """The pixels of a compressed picture.

    Args:
        picture: JPEG or PNG.
        size_px: Width and height to bring it to, by the mean over what a pixel covers; None leaves it as it is.

    Raises:
        DatasetError: If it is no picture.
    """
    from PIL import Image

    try:
        with Image.open(io.BytesIO(picture)) as image:
            pixels = image.convert("RGB")
            if size_px is not None and pixels.size != size_px:
                pixels = pixels.resize(size_px, Image.Resampling.BOX)
            return np.asarray(pixels)
    except (OSError, ValueError, Image.DecompressionBombError) as error:
        raise DatasetError(f"a picture of {len(picture)} bytes cannot be read: {error}.") from error


def decode_all(pictures: Sequence[bytes], size_px: tuple[int, int]) -> UInt8[np.ndarray, "T height width 3"]:
    """The pixels of a camera's pictures, all of one size; one that repeats is read once."""
    out = np.empty((len(pictures), size_px[1], size_px[0], 3), np.uint8)
    for i, picture in enumerate(pictures):
        out[i] = out[i - 1] if i and picture is pictures[i - 1] else decode(picture, size_px)
    return out
