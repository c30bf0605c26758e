"""A camera's videos as LeRobot keeps them: encoded once, from the pictures that were recorded, many episodes a file."""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from wrenchflow.datasets import lerobot_layout as layout
from wrenchflow.datasets.pictures import decode, size_of
from wrenchflow.datasets.pixels import PixelCounts
from wrenchflow.errors import ConfigError, OutputError

# A file takes no further episode then; what the encoder still holds is not counted.
FILE_BYTES = layout.VIDEO_FILE_MB * 2**20
CODEC, PIXELS = "libsvtav1", "yuv420p"
# LeRobot's own: every second picture is whole, so that a policy finds any of them soon.
OPTIONS = {"g": "2", "crf": "30", "preset": "12"}


@dataclass(frozen=True, kw_only=True)
class Clip:
    """Where an episode lies in a camera's videos.

    Attributes:
        file_number: Of the file.
        start_s: Of its first picture in the file [s].
        stop_s: One period after its last [s].
        counts: How often it has each brightness, by channel.
    """

    file_number: int
    start_s: float
    stop_s: float
    counts: PixelCounts


class CameraVideos:
    """One camera's videos, one file after the other."""

    def __init__(self, folder: Path, camera: str, rate_hz: int, first: bytes) -> None:
        self._folder, self._rate_hz = folder, rate_hz
        self.feature = layout.video_feature(camera)
        self._size_px = size_of(first)
        self._container: Any = None
        self._stream: Any = None
        self._pictures = self._bytes = self._files = 0

    def add(self, pictures: Sequence[bytes]) -> Clip:
        """Encode an episode's pictures.

        Raises:
            DatasetError: If one is no picture.
            OutputError: If they cannot be encoded.
        """
        with _told(self.feature):
            if self._container is None or self._bytes > FILE_BYTES:
                self.close()
                self._begin()
            first, counts = self._pictures, PixelCounts()
            for picture in pictures:
                pixels = decode(picture, self._size_px)
                counts = counts.with_(pixels)
                self._encode(pixels)
            return Clip(
                file_number=self._files - 1,
                start_s=first / self._rate_hz,
                stop_s=self._pictures / self._rate_hz,
                counts=counts,
            )

    def close(self) -> None:
        """Finish the file that is being written."""
        if self._container is not None:
            with _told(self.feature):
                self._write(self._stream.encode())
                self._container.close()
            self._container = None

    @property
    def described(self) -> dict[str, Any]:
        """The feature in `meta/info.json`."""
        width_px, height_px = self._size_px
        return {
            "dtype": "video",
            "shape": [height_px, width_px, 3],
            "names": ["height", "width", "channels"],
            "info": {
                "video.height": height_px,
                "video.width": width_px,
                "video.codec": "av1",
                "video.pix_fmt": PIXELS,
                "video.fps": self._rate_hz,
                "video.channels": 3,
                "has_audio": False,
                **{f"video.{name}": int(value) for name, value in OPTIONS.items()},
                "is_depth_map": False,
            },
        }

    @property
    def _path(self) -> Path:
        return self._folder / layout.VIDEO.format(video_key=self.feature, **layout.place(self._files - 1))

    def _begin(self) -> None:
        av = _av()
        self._files, self._pictures, self._bytes = self._files + 1, 0, 0
        self._path.parent.mkdir(parents=True, exist_ok=True)
        self._container = av.open(str(self._path), "w")
        self._stream = self._container.add_stream(CODEC, self._rate_hz, options=OPTIONS)
        self._stream.width, self._stream.height = self._size_px
        self._stream.pix_fmt = PIXELS

    def _encode(self, pixels: np.ndarray) -> None:
        frame = _av().VideoFrame.from_ndarray(pixels, format="rgb24")
        frame.pts = self._pictures
        self._write(self._stream.encode(frame))
        self._pictures += 1

    def _write(self, packets: Sequence[Any]) -> None:
        self._bytes += sum(packet.size for packet in packets)
        self._container.mux(packets)


@contextmanager
def _told(feature: str) -> Iterator[None]:
    try:
        yield
    except (_av().FFmpegError, OSError) as error:
        raise OutputError(f"the video of {feature} cannot be written: {error}.") from error


def _av() -> Any:
    # The encoder would write twenty lines about itself to stderr for each file; errors it still says.
    os.environ.setdefault("SVT_LOG", "1")
    try:
        import av
    except ImportError as error:
        raise ConfigError(
            "LeRobot's videos need PyAV: pip install 'wrenchflow[video]', or export without: --cameras and no name."
        ) from error
    return av
