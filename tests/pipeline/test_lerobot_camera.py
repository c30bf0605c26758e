"""LeRobot's cameras in our recordings: one of its own camera classes, driven through its own factory."""

import io
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from lerobot.cameras.camera import Camera
from lerobot.cameras.configs import CameraConfig
from lerobot.cameras.opencv import OpenCVCameraConfig
from PIL import Image

from wrenchflow.collect.lerobot_camera import LeRobotCamera
from wrenchflow.errors import CameraError
from wrenchflow.recording.images import images_of
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.recorder import Recorder
from wrenchflow.rig import CameraMount
from wrenchflow.signals import FORCE
from wrenchflow.source import Column, Source

ROW = np.dtype([("t_ns", "i8"), ("force", "f8", (3,))], align=True)
LOOP = Source(name="loop", dtype=ROW, columns=(Column(name="force", signal=FORCE, frame="sensor"),))
MOUNT = CameraMount(name="wrist", parent="flange", T_parent_camera=(0, 0, 0.1, 1.0, 0, 0, 0), fov_y_rad=1.0)
LATENCY_S = 0.04


@CameraConfig.register_subclass("ramp")
@dataclass(kw_only=True)
class RampCameraConfig(CameraConfig):
    """Of a camera without hardware."""


class RampCamera(Camera):
    """A camera as LeRobot wants it: a thread takes pictures, each a shade brighter, and notes when."""

    def __init__(self, config: RampCameraConfig) -> None:
        super().__init__(config)
        self.latest_timestamp: float | None = None
        self._running, self._new = False, threading.Event()

    @property
    def is_connected(self) -> bool:
        return self._running

    @staticmethod
    def find_cameras() -> list:
        return []

    def connect(self, warmup: bool = True) -> None:
        self._running, self._shade = True, 0
        self._thread = threading.Thread(target=self._expose, daemon=True)
        self._thread.start()

    def _expose(self) -> None:
        while self._running:
            time.sleep(1.0 / self.fps)
            self._shade += 3
            self.latest_timestamp = time.perf_counter()
            self._new.set()

    def read(self) -> np.ndarray:
        return np.full((self.height, self.width, 3), self._shade % 256, np.uint8)

    def async_read(self, timeout_ms: float = 200.0) -> np.ndarray:
        if not self._new.wait(timeout_ms / 1000.0):
            raise TimeoutError
        self._new.clear()
        return self.read()

    def disconnect(self) -> None:
        self._running = False
        self._thread.join()


def record(path: Path) -> None:
    wrist = LeRobotCamera(
        "wrist", RampCameraConfig(fps=25, width=40, height=32), capture_latency_s=LATENCY_S, mount=MOUNT
    )
    row = np.zeros(1, ROW)
    with Recorder(path, id="7", task="t", sources=[LOOP], cameras=[wrist]) as recorder:
        for _ in range(500):
            row["t_ns"] = recorder.clock.now_ns()
            recorder.push("loop", row)
            time.sleep(0.002)


@pytest.mark.slow
def test_pictures_of_a_lerobot_camera_are_recorded_with_when_they_were_exposed(tmp_path):
    path = tmp_path / "e.mcap"
    ran = subprocess.run([sys.executable, __file__, str(path)], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr
    episode = read_episode(path)
    assert "problem" not in episode.meta["recorded"]["wrist"]
    messages = episode.messages["camera/wrist"]
    assert len(messages) > 10
    shades = [int(np.asarray(Image.open(io.BytesIO(image.data)))[0, 0, 0]) for image in images_of(messages)]
    assert set((np.diff(shades) % 256 // 2).tolist()) <= set(range(1, 30))  # Each once, in their order.
    assert (messages.received - messages.t >= round(LATENCY_S * 1e9)).all()
    assert episode.meta["cameras"]["wrist"] == {
        "name": "wrist",
        "width": 40,
        "height": 32,
        "rate_hz": 25.0,
        "driver": "lerobot-ramp",
        "capture_latency_s": LATENCY_S,
        "parent": "flange",
        "T_parent_camera": list(MOUNT.T_parent_camera),
        "fov_y_rad": 1.0,
    }


def test_a_configuration_that_leaves_the_size_open_is_refused():
    with pytest.raises(CameraError, match="camera 'wrist' needs fps, width and height, got 30, None and 480"):
        LeRobotCamera("wrist", OpenCVCameraConfig(index_or_path=0, fps=30, height=480))


def test_a_camera_that_is_not_plugged_in_is_told(tmp_path):
    absent = LeRobotCamera("wrist", OpenCVCameraConfig(index_or_path=63, fps=30, width=640, height=480))
    with pytest.raises(CameraError, match=r"camera 'wrist' cannot be opened: Failed to open OpenCVCamera\(63\)"):
        Recorder(tmp_path / "e.mcap", id="7", task="t", sources=[LOOP], cameras=[absent])
    assert list(tmp_path.iterdir()) == []


if __name__ == "__main__":
    record(Path(sys.argv[1]))
