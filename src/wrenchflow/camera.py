"""Cameras: what takes pictures, in a process of its own, and what is known of the views that it has."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import UInt8

from wrenchflow.clock import Clock
from wrenchflow.errors import ConfigError

_LEAST_BYTES = 16 * 1024


@dataclass(frozen=True, kw_only=True)
class View:
    """One stream of pictures, and what a recording says of it.

    Attributes:
        name: Of the view; its topic is `camera/<name>`.
        width: Of a picture [pixels].
        height: Of a picture [pixels].
        rate_hz: Pictures a second.
        driver: What takes them, such as `mujoco-egl` or `lerobot-opencv`.
        capture_latency_s: From the exposure until the driver hands the picture over [s]; stamps are corrected by it.
        parent: Frame that the camera is mounted on: `flange` or `base`; empty where it is not known.
        T_parent_camera: Pose of the camera in it, x to the right, y down, z to the front; None where it is not known.
        fov_y_rad: Vertical field of view [rad]; None where it is not known.
    """

    name: str
    width: int = 224
    height: int = 224
    rate_hz: float = 30.0
    driver: str = ""
    capture_latency_s: float = 0.0
    parent: str = ""
    T_parent_camera: tuple[float, ...] | None = None
    fov_y_rad: float | None = None

    def __post_init__(self) -> None:
        if not self.name or not 1 <= self.width <= 8192 or not 1 <= self.height <= 8192 or not 0 < self.rate_hz <= 1000:
            raise ConfigError(
                f"camera '{self.name}' is {self.width} x {self.height} at {self.rate_hz:g} Hz, expected a name, 1 to "
                "8192 pixels and at most 1000 Hz."
            )

    @property
    def frame(self) -> str:
        """Name of the camera's own frame."""
        return f"camera/{self.name}"

    @property
    def row(self) -> np.dtype:
        """How a compressed picture lies in a ring; one that needs more than a byte a pixel has no place there."""
        most = max(self.width * self.height, _LEAST_BYTES)
        return np.dtype(
            [("t_ns", "i8"), ("received_ns", "i8"), ("sequence", "i8"), ("size", "i8"), ("data", "u1", (most,))]
        )


class Picture(NamedTuple):
    """What a camera took.

    Attributes:
        view: Name of the view.
        t_ns: When it was exposed, by the recording's clock [ns].
        sequence: Its number at the camera, so that a picture that is missing can be counted.
        pixels: Red, green, blue. Shape (height, width, 3).
    """

    view: str
    t_ns: int
    sequence: int
    pixels: UInt8[np.ndarray, "height width 3"]


@runtime_checkable
class Camera(Protocol):
    """A driver. It travels to a process of its own, where `open`, `take` and `close` are called, and nothing else."""

    @property
    def views(self) -> tuple[View, ...]:
        """What it takes pictures of; known before it is opened."""
        ...

    def open(self, clock: Clock) -> None:
        """Get ready; raises a `WrenchflowError` that says why where that is not possible."""
        ...

    def take(self) -> Iterable[Picture]:
        """The pictures since the last call; waits for one, but at most 100 ms, and may have none."""
        ...

    def close(self) -> None:
        """Let go of the device."""
        ...
