"""Records while it happens: the control loop stores a row and goes on; another process writes the file."""

import multiprocessing
import select
import time
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from multiprocessing.connection import wait
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from wrenchflow.camera import Camera
from wrenchflow.clock import Clock
from wrenchflow.config import to_mapping
from wrenchflow.episode import Event
from wrenchflow.errors import OutputError, StreamError, unknown
from wrenchflow.messages import Attachment
from wrenchflow.recording.camera_process import CameraProcess
from wrenchflow.recording.ring import Ring
from wrenchflow.recording.writer_process import EVENT, EVENT_CAPACITY, Job, event_row, run_writer
from wrenchflow.source import Source

_START_S = 60.0
_FINISH_S = 60.0
_LOOK_S = 0.02


class Recorder:
    """Records one episode.

        with Recorder(path, id="0007", task="peg-insertion", sources=[control]) as recorder:
            while going_on():
                recorder.push("control", row)  # A microsecond; never waits.
                if not recorder.is_alive:
                    hold()
            recorder.finish({"success": True})

    Stamps are of `recorder.clock`, the monotonic clock, mapped to the epoch when the recorder was made. The file is
    `<path>.partial` until `finish`. If the block ends in an exception, the file is completed with that as
    its result. If the control process itself dies, the writer completes the file without it.
    """

    def __init__(
        self,
        path: Path,
        *,
        id: str,
        task: str,
        sources: Sequence[Source],
        cameras: Sequence[Camera] = (),
        mirrors: Mapping[str, str] | None = None,
        taps: Mapping[str, str] | None = None,
        meta: Mapping[str, Any] | None = None,
        attachments: Mapping[str, Attachment] | None = None,
        compression: str = "zstd",
    ) -> None:
        """Make the rings and start the writer; returns once the file is begun.

        Args:
            path: Where the finished file goes.
            id: Name of the episode.
            task: The task that is attempted.
            sources: What will be recorded.
            cameras: Each gets a process of its own, and its pictures come by themselves.
            mirrors: Name of another ring, by view, that gets the pictures too: of `LiveView.pictures`, for one.
            taps: Name of a ring of `TAP_ROWS` rows, by source, that gets its rows too, from the writer: for who looks
                at what is recorded while it happens, without a cost to the loop.
            meta: JSON values that are known at the start.
            attachments: Files that the recording carries, by name.
            compression: Of the chunks: zstd, lz4 or none.

        Raises:
            CameraError: If a camera cannot be opened.
            OutputError: If the file cannot be begun.
            StreamError: If two streams have one name.
        """
        views = tuple(view for camera in cameras for view in camera.views)
        names = [source.name for source in sources] + [view.name for view in views]
        if len(set(names)) != len(names):
            raise StreamError(f"sources and cameras need names of their own, got {', '.join(names)}.")
        self.path, self.clock = path, Clock.start()
        self._rings: dict[str, Ring] = {}
        self._cameras: list[CameraProcess] = []
        with ExitStack() as undo:  # Where there is no room for one of them, the others go.
            for source in sources:
                self._rings[source.name] = _made(Ring.create(source.dtype, source.capacity), undo)
            self._events = _made(Ring.create(EVENT, EVENT_CAPACITY), undo)
            for camera in cameras:
                self._cameras.append(CameraProcess(camera, self.clock, mirrors or {}))
                undo.callback(self._cameras[-1].release)
            undo.pop_all()
        pictures = [ring for camera in self._cameras for ring in camera.rings]
        known = {"cameras": {view.name: to_mapping(view) for view in views}} if views else {}
        job = Job(
            path=path,
            id=id,
            task=task,
            meta={**(meta or {}), **known},
            compression=compression,
            sources=tuple(sources),
            views=views,
            taps=dict(taps or {}),
            rings=tuple(ring.name for ring in (*self._rings.values(), *pictures, self._events)),
            clock=self.clock,
            attachments=dict(attachments or {}),
        )
        context = multiprocessing.get_context("spawn")
        self._control, theirs = context.Pipe()
        self._process = context.Process(target=run_writer, args=(job, theirs), name="wrenchflow-writer", daemon=True)
        self._looked_s, self._was_alive, self._finished, self._is_done = 0.0, True, False, False
        try:
            for camera in self._cameras:
                camera.wait_until_open()
            self._process.start()
            theirs.close()
            self._end = select.poll()  # Made once: a look then costs a microsecond.
            self._end.register(self._process.sentinel, select.POLLIN)
            self._expect("begin", _START_S)
            for camera in self._cameras:
                camera.begin()
        except BaseException:
            self._release()
            raise

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._finished:
            return
        if kind is None:
            self.finish()
        elif self.is_alive:
            self.finish({"success": False, "failure": f"interrupted: {kind.__name__}"})
        else:
            self._release()

    def push(self, source: str, row: np.ndarray) -> bool:
        """Store a row, an array of one record of the source's dtype; False where the ring is full. Never waits."""
        return self._rings[source].push(row)

    def ring(self, source: str) -> Ring:
        """The ring of a source, for a loop that does not want to look it up.

        Raises:
            StreamError: If there is no such source.
        """
        if source not in self._rings:
            raise StreamError(unknown("source", source, self._rings))
        return self._rings[source]

    def event(self, event: Event) -> bool:
        """Note an event; False where there are too many at once."""
        return self._events.push(event_row(event))

    @property
    def is_alive(self) -> bool:
        """Whether the writer lives, as of at most 20 ms ago: the look itself is a system call."""
        now_s = time.monotonic()
        if self._was_alive and now_s - self._looked_s > _LOOK_S:
            self._was_alive, self._looked_s = not self._end.poll(0), now_s
        return self._was_alive

    @property
    def writer_pid(self) -> int:
        """Number of the writer's process."""
        assert self._process.pid is not None
        return self._process.pid

    @property
    def dropped(self) -> int:
        """Rows that found their ring full."""
        return sum(ring.dropped for ring in self._rings.values())

    def finish(self, result: Any = None, safety: Any = None) -> dict[str, Any]:
        """Let the writer write all that waits, and complete the file.

        Args:
            result: A JSON value that says what came of the episode.
            safety: A JSON value that says what the safety layer did; None leaves it out.

        Returns:
            What the file says of each source and view: rows, missing numbers, drops, gaps, jitter, and problems.

        Raises:
            OutputError: If the writer died or could not write; what is on the disk stays `.partial`.
        """
        if self._finished:
            return {}
        try:
            problems = {name: said for camera in self._cameras for name, said in camera.stop().items()}
            with suppress(OSError):  # A writer that has gone may have said why: that is read below.
                self._control.send(({} if result is None else result, safety, problems))
            recorded = self._expect("finish", _FINISH_S)
            self._is_done = True
            return recorded
        finally:
            self._release()

    def _expect(self, what: str, patience_s: float) -> dict[str, Any]:
        ready = wait([self._control, self._process.sentinel], patience_s)
        if self._control in ready:
            try:
                said = self._control.recv()
            except (EOFError, OSError) as error:
                raise self._lost() from error
            if isinstance(said, dict):
                return said
            raise OutputError(said)
        if ready:
            raise self._lost()
        raise OutputError(f"the writer of {self.path} did not {what} within {patience_s:g} s.")

    def _lost(self) -> OutputError:
        partial = self.path.with_name(self.path.name + ".partial")
        return OutputError(
            f"the writer of {self.path} died. What it wrote is in {partial}: run `wrenchflow recover {partial}`."
        )

    def _release(self) -> None:
        self._finished = True
        for camera in self._cameras:
            camera.release()
        self._control.close()
        # One that was never started has nothing to end: a camera was not there. One that is done ends by itself; it is
        # not waited for, because to take a process down takes as long as to write a second of recording.
        if self._process.pid is not None and not self._is_done:
            self._process.join(1.0)
            if self._process.is_alive():
                self._process.kill()
                self._process.join()
        for ring in (*self._rings.values(), self._events):
            ring.close()
            ring.unlink()


def _made(ring: Ring, undo: ExitStack) -> Ring:
    undo.callback(ring.unlink)
    undo.callback(ring.close)
    return ring
