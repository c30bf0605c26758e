"""Real cameras: any camera class of LeRobot, as a camera of ours. Needs `lerobot`, and loads it in its own process."""

import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from wrenchflow.camera import Picture, View
from wrenchflow.clock import Clock
from wrenchflow.errors import CameraError
from wrenchflow.rig import CameraMount

_WAIT_MS = 100.0


class LeRobotCamera:
    """A LeRobot camera; a `Camera` that takes what its driver has when it has it.

    from lerobot.cameras.opencv import OpenCVCameraConfig
    wrist = LeRobotCamera("wrist", OpenCVCameraConfig(0, fps=30, width=640, height=480), capture_latency_s=0.04)
    with Recorder(path, id="0007", task="peg", sources=[control], cameras=[wrist]) as recorder: ...
    """

    def __init__(
        self, name: str, config: Any, *, capture_latency_s: float = 0.0, mount: CameraMount | None = None
    ) -> None:
        """Say which camera.

        Args:
            name: Of the view.
            config: LeRobot's configuration of the camera; fps, width and height are set.
            capture_latency_s: From the exposure until the driver has the picture [s].
            mount: Where it sits, and how wide it sees.

        Raises:
            CameraError: If the configuration leaves size or rate open: a recording says them before the first picture.
        """
        if not (config.fps and config.width and config.height):
            raise CameraError(
                f"camera '{name}' needs fps, width and height, got {config.fps}, {config.width} and {config.height}."
            )
        self._config = config
        self._view = View(
            name=name,
            width=config.width,
            height=config.height,
            rate_hz=float(config.fps),
            driver=f"lerobot-{config.type}",
            capture_latency_s=capture_latency_s,
            parent=mount.parent if mount else "",
            T_parent_camera=mount.T_parent_camera if mount else None,
            fov_y_rad=mount.fov_y_rad if mount else None,
        )

    @property
    def views(self) -> tuple[View, ...]:
        """The one view."""
        return (self._view,)

    def open(self, clock: Clock) -> None:
        """Connect, and let the camera settle."""
        try:
            from lerobot.cameras.utils import make_cameras_from_configs
        except ImportError as error:
            raise CameraError(f"camera '{self._view.name}' needs LeRobot, which is not installed: {error}") from error
        self._clock, self._number, self._stamp_s = clock, 0, None
        self._camera = make_cameras_from_configs({self._view.name: self._config})[self._view.name]
        try:
            self._camera.connect()
        except Exception as error:  # Every driver has errors of its own, and all mean that there is no camera.
            raise CameraError(f"camera '{self._view.name}' cannot be opened: {error}") from error

    def take(self) -> Iterator[Picture]:
        """The next picture, if there is one within 100 ms."""
        try:
            pixels = self._camera.async_read(timeout_ms=_WAIT_MS)
        except TimeoutError:
            return
        # Most drivers note when a picture came, by the clock that is monotonic; the others are asked just after.
        stamp_s = getattr(self._camera, "latest_timestamp", None) or time.perf_counter()
        if stamp_s == self._stamp_s:
            return
        self._stamp_s = stamp_s
        t_ns = self._clock.at_ns(round((stamp_s - self._view.capture_latency_s) * 1e9))
        yield Picture(self._view.name, t_ns, self._number, np.ascontiguousarray(pixels))
        self._number += 1

    def close(self) -> None:
        """Disconnect."""
        camera = getattr(self, "_camera", None)
        if camera is not None and camera.is_connected:
            camera.disconnect()
