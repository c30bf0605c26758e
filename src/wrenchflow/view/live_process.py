"""The process that shows an episode while it is recorded: it drains the rings, and logs to a viewer or to a file."""

import multiprocessing
import os
import time
from collections import deque
from multiprocessing.connection import Connection, wait

import numpy as np
import rerun as rr

from wrenchflow.errors import WrenchflowError
from wrenchflow.recording.camera_process import PICTURES_WAITING
from wrenchflow.recording.child import leave_signals_to_parent
from wrenchflow.recording.ring import Ring
from wrenchflow.source import Source, T, samples_of
from wrenchflow.view import style
from wrenchflow.view.blueprint import make_blueprint
from wrenchflow.view.contents import PATH, TIMELINE, Contents
from wrenchflow.view.feed import ROWS_WAITING, Decimation, Job
from wrenchflow.view.log import APPLICATION, log_images, log_samples, log_start
from wrenchflow.view.rrd_file import begin_file, finish_file
from wrenchflow.view.viewer import viewer_at

_POLL_S = 0.1
_TRAIL_POINTS = 500
_NICENESS = 10  # Less urgent than the control loop; the viewer inherits it.


def run_live(job: Job, control: Connection) -> None:
    """Log until told to finish, or until nobody is there who could tell."""
    leave_signals_to_parent()
    os.nice(_NICENESS)
    parent = multiprocessing.parent_process()
    assert parent is not None
    try:
        showing = _Showing(job)
    except (WrenchflowError, OSError) as error:
        control.send(str(error))
        return
    try:
        control.send("")  # Ready.
        is_over = False
        while not is_over:
            is_over = bool(wait([control, parent.sentinel], _POLL_S))
            showing.pass_on()
        showing.finish()
    finally:
        showing.close(unlink=not parent.is_alive())


class _Showing:
    """The rings and Rerun's recording."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self._contents = Contents.of_sources(job.id, job.sources, [view.frame for view in job.views], job.meta)
        self._recording = rr.RecordingStream(APPLICATION, send_properties=False)
        self._recording.set_log_time_enabled(False)
        self._recording.set_log_tick_enabled(False)
        if job.save is None:
            self._recording.connect_grpc(viewer_at(job.port))
        else:
            self._recording.save(begin_file(job.save))
        self._recording.send_blueprint(make_blueprint(self._contents, live=True))
        log_start(self._recording, self._contents, time.time_ns())
        kinds = [(source.dtype, ROWS_WAITING) for source in job.sources]
        kinds += [(view.row, PICTURES_WAITING) for view in job.views]
        self._rings = [Ring.attach(name, *kind) for name, kind in zip(job.rings, kinds, strict=True)]
        self._decimations = [Decimation(job.picture_rate_hz) for _ in job.views]
        self._start_ns: dict[str, int] = {}
        self._trail: deque[np.ndarray] = deque(maxlen=_TRAIL_POINTS)

    def pass_on(self) -> None:
        """Log what waits."""
        n = len(self._job.sources)
        for source, ring in zip(self._job.sources, self._rings[:n], strict=True):
            rows = ring.take()
            if len(rows):
                self._log(source, rows)
        for view, ring, decimation in zip(self._job.views, self._rings[n:], self._decimations, strict=True):
            rows = [row for row in ring.take() if decimation.passes(int(row[T]))]
            if rows:
                pictures = [row["data"][: row["size"]].tobytes() for row in rows]
                log_images(self._recording, view.frame, [int(row[T]) for row in rows], pictures)

    def _log(self, source: Source, rows: np.ndarray) -> None:
        start_ns = self._start_ns.setdefault(source.name, int(rows[T][0]))
        for column in source.columns:
            samples = samples_of(rows, column, start_ns)
            log_samples(self._recording, self._contents, column.name, samples.t, samples.data)
            if column.name == self._contents.body and len(samples.t):
                self._trail.extend(samples.data[:, :3])
                self._recording.set_time(TIMELINE, timestamp=np.datetime64(int(samples.t[-1]), "ns"))
                self._recording.log(PATH, style.path_of(np.array(self._trail)))

    def finish(self) -> None:
        """Log what still waits, and complete the file if there is one."""
        self.pass_on()
        try:
            self._recording.flush()
        except RuntimeError:
            return  # The window was closed, or the disk is full; a file stays `.partial`.
        self._recording.disconnect()
        if self._job.save is not None:
            finish_file(self._job.save)

    def close(self, *, unlink: bool) -> None:
        """Let go of the rings; where whoever made them is no more, they end with us."""
        for ring in self._rings:
            ring.close()
            if unlink:
                ring.unlink()
