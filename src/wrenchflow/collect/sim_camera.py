"""The simulator's cameras: drawn in their own process while it happens, or all at once when it is over."""

import logging
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from wrenchflow.camera import Picture, View
from wrenchflow.clock import Clock
from wrenchflow.collect.config import CollectConfig
from wrenchflow.control.controller import TICK_NS
from wrenchflow.errors import CameraError
from wrenchflow.messages import Messages
from wrenchflow.recording.images import image_messages, jpeg
from wrenchflow.recording.ring import TAP_ROWS, Ring
from wrenchflow.rig import Rig
from wrenchflow.sim.attempt import picture_at
from wrenchflow.sim.gl import PACKAGES, find_gl
from wrenchflow.sim.render import Renderer

_NAP_S = 0.002
_WAIT_S = 0.1


def without_what_cannot_be_drawn(config: CollectConfig) -> CollectConfig:
    """The configuration as it is; without its cameras, which is said, where nothing can be drawn on this machine."""
    if not config.cameras or find_gl() is not None:
        return config
    logging.getLogger("wrenchflow").warning(
        "no cameras are recorded: neither EGL nor OSMesa works here. On Debian, install %s.", PACKAGES
    )
    return replace(config, cameras=())


def views_of(config: CollectConfig, rig: Rig) -> tuple[View, ...]:
    """The views that a configuration asks for.

    Raises:
        CameraError: If nothing can be drawn on this machine.
        ConfigError: If the rig has no such camera.
    """
    mounts = [rig.camera(name) for name in config.cameras]
    gl = find_gl() if mounts else None
    if mounts and gl is None:
        raise CameraError(f"neither EGL nor OSMesa works here. On Debian, install {PACKAGES}.")
    return tuple(
        View(
            name=mount.name,
            width=config.camera.width,
            height=config.camera.height,
            rate_hz=config.camera.rate_hz,
            driver=f"mujoco-{gl}",
            parent=mount.parent,
            T_parent_camera=mount.T_parent_camera,
            fov_y_rad=mount.fov_y_rad,
        )
        for mount in mounts
    )


def _renderer(mjcf: str, view: View) -> Renderer:
    return Renderer(mjcf, view.driver.removeprefix("mujoco-"), view.width, view.height)


class SimCamera:
    """Draws all views of a scene at their rate, from the rows of the control loop; a `Camera`.

    A row says in `looks` what the scene looks like after its tick, and in `sequence` how many ticks came before.
    """

    def __init__(self, mjcf: str, views: tuple[View, ...], ring: str, row: np.dtype) -> None:
        """Say what to draw, and whence the rows come.

        Args:
            mjcf: The model.
            views: Of one size and one rate.
            ring: Name of a ring that the recorder's writer fills: of a tap.
            row: Of the rows in it.
        """
        self._mjcf, self._views, self._ring_name, self._row = mjcf, views, ring, row

    @property
    def views(self) -> tuple[View, ...]:
        """What it takes pictures of."""
        return self._views

    def open(self, clock: Clock) -> None:
        """Load the model, and draw every view once: the first pictures take longest."""
        self._renderer = _renderer(self._mjcf, self._views[0])
        for view in self._views:
            self._renderer.draw(view.name)
        self._ring = Ring.attach(self._ring_name, self._row, TAP_ROWS)

    def take(self) -> Iterator[Picture]:
        """Every view of every moment that waits and is due."""
        until_s = time.monotonic() + _WAIT_S
        while len(rows := self._ring.take()) == 0 and time.monotonic() < until_s:
            time.sleep(_NAP_S)
        for row in rows:
            number = picture_at(int(row["sequence"]) + 1, self._views[0].rate_hz)
            if number is not None:
                yield from _draw(self._renderer, self._views, int(row["t_ns"]) + TICK_NS, number, row["looks"])

    def close(self) -> None:
        """Let go of the context and the ring."""
        if hasattr(self, "_ring"):  # Without it, opening has failed.
            self._renderer.close()
            self._ring.close()


def _draw(renderer: Renderer, views: Iterable[View], t_ns: int, number: int, looks: np.ndarray) -> Iterator[Picture]:
    renderer.set(looks)
    for view in views:
        yield Picture(view.name, t_ns, number, renderer.draw(view.name))


class Album:
    """The moments of an attempt in virtual time, which are drawn when it is over."""

    def __init__(self, views: tuple[View, ...]) -> None:
        """Be empty."""
        self._views = views
        self._moments: list[tuple[int, int, np.ndarray]] = []

    def __call__(self, t_ns: int, number: int, looks: np.ndarray) -> None:
        """Keep a moment."""
        self._moments.append((t_ns, number, looks))

    def draw(self, mjcf: str) -> dict[str, Messages]:
        """The pictures of each view of a model, by topic."""
        if not self._views:
            return {}
        renderer = _renderer(mjcf, self._views[0])
        taken: dict[str, list[bytes]] = {view.name: [] for view in self._views}
        for t_ns, number, looks in self._moments:
            for picture in _draw(renderer, self._views, t_ns, number, looks):
                taken[picture.view].append(jpeg(picture.pixels))
        renderer.close()
        t = np.array([t_ns for t_ns, _, _ in self._moments], np.int64)
        return {view.frame: image_messages(t, taken[view.name], view.frame) for view in self._views}
