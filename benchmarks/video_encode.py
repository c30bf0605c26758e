"""Encoding a camera's pictures: our writer against LeRobot's own, the same pictures and settings, in one process.

LeRobot's side starts from PNG files, as its recorder leaves them, and its writing of them is measured beside it; ours
starts from the JPEG of a recording, and counts every pixel for the statistics meanwhile. Run it as
`python benchmarks/video_encode.py`.
"""

import logging
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np
from lerobot.datasets.video_utils import encode_video_frames
from PIL import Image

from wrenchflow.datasets.pictures import decode
from wrenchflow.datasets.video import CameraVideos
from wrenchflow.recording.images import jpeg

PICTURES, SIDE_PX, RATE_HZ, REPEATS = 600, 224, 20, 3


def scene(number: int) -> np.ndarray:
    """A textured ground, over which something moves."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:SIDE_PX, :SIDE_PX]
    ground = 110 + 40 * np.sin(x / 9) + 30 * np.cos(y / 13) + rng.normal(0, 6, (SIDE_PX, SIDE_PX))
    away = np.hypot(x - 112 - 60 * np.sin(number / 30), y - 112 - 40 * np.cos(number / 40))
    pixels = np.where(away[..., None] < 25, [220, 60, 40], ground[..., None])
    return np.clip(pixels + rng.normal(0, 2, (SIDE_PX, SIDE_PX, 1)), 0, 255).astype(np.uint8)


def main() -> None:
    """Measure both sides in turn and print them."""
    logging.disable(logging.WARNING)
    pictures = [jpeg(scene(k)) for k in range(PICTURES)]
    ours_hz, theirs_hz, with_png_hz = [], [], []
    for _ in range(REPEATS + 1):  # The first round warms up.
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            start = time.perf_counter()
            videos = CameraVideos(folder, "wrist", RATE_HZ, pictures[0])
            videos.add(pictures)
            videos.close()
            ours_hz.append(PICTURES / (time.perf_counter() - start))
            ours_bytes = sum(file.stat().st_size for file in folder.rglob("*.mp4"))
            pixels = [decode(picture) for picture in pictures]
            (folder / "png").mkdir()
            start = time.perf_counter()
            for k, each in enumerate(pixels):
                Image.fromarray(each).save(folder / "png" / f"frame-{k:06d}.png", compress_level=1)
            written = time.perf_counter() - start
            start = time.perf_counter()
            encode_video_frames(folder / "png", folder / "theirs.mp4", RATE_HZ)
            took = time.perf_counter() - start
            theirs_hz.append(PICTURES / took)
            with_png_hz.append(PICTURES / (took + written))
            theirs_bytes = (folder / "theirs.mp4").stat().st_size
    ours, theirs, with_png = (median(each[1:]) for each in (ours_hz, theirs_hz, with_png_hz))
    print(f"ours {ours:.0f} pictures/s ({ours_bytes / 1e6:.2f} MB), from JPEG, with statistics")
    print(
        f"LeRobot {theirs:.0f} pictures/s ({theirs_bytes / 1e6:.2f} MB), from PNG: {ours / theirs:.2f} times (goal 1)"
    )
    print(f"LeRobot with the writing of the PNG {with_png:.0f} pictures/s: {ours / with_png:.2f} times")


if __name__ == "__main__":
    main()
