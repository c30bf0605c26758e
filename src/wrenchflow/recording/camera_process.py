"""The process that a camera lives in: it takes pictures, compresses them, and puts them into rings for the writer.

A driver may block, crash or take its time, and a picture takes milliseconds to compress: none of that is near the
control loop, and none of it delays what the writer has to write.
"""

import multiprocessing
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait

import numpy as np

from wrenchflow.camera import Camera, Picture, View
from wrenchflow.clock import Clock
from wrenchflow.errors import CameraError, WrenchflowError, unknown
from wrenchflow.recording.child import leave_signals_to_parent
from wrenchflow.recording.images import jpeg
from wrenchflow.recording.ring import Ring, load_push

PICTURES_WAITING = 8  # What a ring of pictures holds, at most.
_OPEN_S = 60.0
_STOP_S = 5.0


@dataclass(frozen=True, kw_only=True)
class _Job:
    camera: Camera
    rings: tuple[str, ...]
    mirrors: Mapping[str, str]
    clock: Clock


class CameraProcess:
    """A camera at work; ends with `stop` or with the process that made it.

    Attributes:
        rings: Where the pictures of each view come.
    """

    def __init__(self, camera: Camera, clock: Clock, mirrors: Mapping[str, str]) -> None:
        """Start it; `wait_until_open` says whether it could be opened.

        Args:
            camera: What takes pictures.
            clock: That all stamps are of.
            mirrors: Name of another ring, by view, that gets the same pictures.
        """
        self._views = camera.views
        self.rings = [Ring.create(view.row, PICTURES_WAITING) for view in self._views]
        names = tuple(ring.name for ring in self.rings)
        job = _Job(camera=camera, rings=names, mirrors=dict(mirrors), clock=clock)
        context = multiprocessing.get_context("spawn")
        self._control, theirs = context.Pipe()
        self._process = context.Process(target=_run, args=(job, theirs), name="wrenchflow-camera", daemon=True)
        self._process.start()
        theirs.close()

    @property
    def _names(self) -> str:
        return ", ".join(view.name for view in self._views)

    def wait_until_open(self) -> None:
        """Wait for the driver.

        Raises:
            CameraError: If it says why it could not be opened, died, or took more than a minute.
        """
        said = self._receive(_OPEN_S)
        if said is None:
            raise CameraError(f"camera '{self._names}' did not open within {_OPEN_S:g} s.")
        if said:
            raise CameraError(said)

    def begin(self) -> None:
        """Let it take pictures: there is somebody who writes them."""
        self._control.send("begin")

    def stop(self) -> dict[str, str]:
        """Let it push what it has, and end it; returns what went wrong while it ran, by view."""
        with suppress(OSError):  # One that has ended is told nothing; why it ended is read below.
            self._control.send("stop")
        said = self._receive(_STOP_S)
        if said is None:
            said = f"camera '{self._names}' did not end within {_STOP_S:g} s."
        return {view.name: said for view in self._views} if said else {}

    def _receive(self, patience_s: float) -> str | None:
        ready = wait([self._control, self._process.sentinel], patience_s)
        if not ready:
            return None
        try:
            return self._control.recv()
        except (EOFError, OSError):
            return f"the process of camera '{self._names}' died."

    def release(self) -> None:
        """End what is still there."""
        self._control.close()
        if self._process.is_alive():
            self._process.join(0.5)
            self._process.kill()
        self._process.join()
        for ring in self.rings:
            ring.close()
            ring.unlink()


def _run(job: _Job, control: Connection) -> None:
    leave_signals_to_parent()
    parent = multiprocessing.parent_process()
    assert parent is not None
    views, rings = job.camera.views, []
    feeds = {}
    for view, name in zip(views, job.rings, strict=True):
        names = (name, job.mirrors[view.name]) if view.name in job.mirrors else (name,)
        own = [Ring.attach(name, view.row, PICTURES_WAITING) for name in names]
        rings += own
        feeds[view.name] = _Feed(view, own, job.clock)
    said = f"the process of camera '{', '.join(feeds)}' ended by itself."
    try:
        job.camera.open(job.clock)
        # What a picture takes is loaded now, and not while pictures wait.
        jpeg(np.zeros((8, 8, 3), np.uint8))
        load_push()
        control.send("")
        control.recv()  # A picture that is taken before somebody writes would find its ring full.
        while not wait([control, parent.sentinel], 0):
            _push(job.camera.take(), feeds)
        _push(job.camera.take(), feeds)  # What was under way when we were told to stop.
        said = ""
    except EOFError:
        said = ""  # Whoever made us went before anything began.
    except WrenchflowError as error:
        said = str(error)
    except Exception as error:  # A driver is somebody else's; whatever it raises is what the camera died of.
        said = f"camera '{', '.join(feeds)}' failed with {type(error).__name__}: {error}"
    finally:
        job.camera.close()
        with suppress(OSError):  # Nobody may be there to be told.
            control.send(said)
        for ring in rings:
            ring.close()


def _push(pictures: Iterable[Picture], feeds: "dict[str, _Feed]") -> None:
    for picture in pictures:
        if picture.view not in feeds:
            raise CameraError(unknown("view", picture.view, feeds))
        feeds[picture.view].push(picture)


class _Feed:
    """One view's way into its rings."""

    def __init__(self, view: View, rings: Sequence[Ring], clock: Clock) -> None:
        self._view, self._rings, self._clock = view, rings, clock
        self._row = np.zeros(1, view.row)
        self._head_bytes = view.row.itemsize - view.row["data"].itemsize

    def push(self, picture: Picture) -> None:
        expected = (self._view.height, self._view.width, 3)
        if picture.pixels.shape != expected:
            raise CameraError(f"camera '{self._view.name}' gave {picture.pixels.shape}, expected {expected}.")
        row, data = self._row[0], jpeg(picture.pixels)
        if len(data) > len(row["data"]):
            for ring in self._rings:
                ring.refuse()
            return
        row["t_ns"], row["sequence"], row["size"] = picture.t_ns, picture.sequence, len(data)
        row["received_ns"] = self._clock.now_ns()
        row["data"][: len(data)] = np.frombuffer(data, np.uint8)
        for ring in self._rings:
            ring.push(self._row, self._head_bytes + len(data))
