"""Shows an episode while it is recorded: the control loop stores a row now and then, another process does the rest."""

import multiprocessing
from collections.abc import Mapping, Sequence
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from wrenchflow.camera import View
from wrenchflow.errors import OutputError
from wrenchflow.recording.camera_process import PICTURES_WAITING
from wrenchflow.recording.ring import Ring
from wrenchflow.source import Source, T
from wrenchflow.view.feed import ROWS_WAITING, Decimation, Job

PORT = 9876  # Rerun's own: a viewer that is open already is found there.
_START_S = 60.0
_FINISH_S = 5.0


class LiveView:
    """Rerun's viewer, fed by a control loop.

        with LiveView("0007", sources, meta={"rig": to_mapping(rig)}) as view:
            while going_on():
                view.push("control", row)  # Every row; a few times a second one is passed on.

    `push` never waits: rows lie in shared memory until another process, of lower priority, logs them. What does not
    fit is dropped and counted. If that process or the viewer dies, pushes go nowhere, and nothing else happens. A file
    whose writing fails stays `.partial`.

    A viewer that listens on the port is used, so that all episodes of a session come to one window; else one is opened,
    which listens on the loopback only and stays open afterwards.

    Attributes:
        pictures: A ring for each view, into which whoever has the view's pictures pushes them, in rows of `View.row`.
            From another process it is attached by its name, with `recording.camera_process.PICTURES_WAITING` rows.
    """

    def __init__(
        self,
        id: str,
        sources: Sequence[Source],
        *,
        views: Sequence[View] = (),
        meta: Mapping[str, Any] | None = None,
        save: Path | None = None,
        port: int = PORT,
        rate_hz: float = 50.0,
        picture_rate_hz: float = 10.0,
    ) -> None:
        """Make the rings and start the process; returns once it listens, which takes a few seconds.

        Args:
            id: Name of the episode.
            sources: Whose rows are shown.
            views: Of the cameras.
            meta: As the recorder has it; of it, `rig` says where the sensor sits.
            save: Write this `.rrd` file instead of showing anything.
            port: Of the viewer, on the loopback.
            rate_hz: Rows that are shown of a source at most [Hz].
            picture_rate_hz: Pictures that are shown of a view at most [Hz].

        Raises:
            OutputError: If there is no viewer to be had, or the file cannot be written.
        """
        self._rows = {source.name: Ring.create(source.dtype, ROWS_WAITING) for source in sources}
        self._decimations = {source.name: Decimation(rate_hz) for source in sources}
        self.pictures = {view.name: Ring.create(view.row, PICTURES_WAITING) for view in views}
        self._rings = [*self._rows.values(), *self.pictures.values()]
        job = Job(
            id=id,
            sources=tuple(sources),
            views=tuple(views),
            picture_rate_hz=picture_rate_hz,
            meta=dict(meta or {}),
            save=save,
            port=port,
            rings=tuple(ring.name for ring in self._rings),
        )
        context = multiprocessing.get_context("spawn")
        self._control, theirs = context.Pipe()
        self._process = context.Process(target=_run, args=(job, theirs), name="wrenchflow-live", daemon=True)
        self._process.start()
        theirs.close()
        try:
            self._expect_ready()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "LiveView":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def push(self, source: str, row: np.ndarray) -> None:
        """Take a row, an array of one record of the source's dtype; most are not passed on. Never waits."""
        if self._decimations[source].passes(int(row[T][0])):
            self._rows[source].push(row)

    @property
    def dropped(self) -> int:
        """Rows and pictures that were due and found their ring full."""
        return sum(ring.dropped for ring in self._rings)

    @property
    def pid(self) -> int:
        """Number of the process that logs."""
        assert self._process.pid is not None
        return self._process.pid

    def close(self) -> None:
        """Let the process log what waits, for a few seconds at most, and end it; the viewer stays open."""
        if not self._rings:
            return
        with suppress(OSError):  # It has died, and nobody minds.
            self._control.send("finish")
        self._process.join(_FINISH_S)
        if self._process.is_alive():  # It waits for a viewer that does not answer.
            self._process.kill()
            self._process.join()
        self._control.close()
        for ring in self._rings:
            ring.close()
            ring.unlink()
        self._rings.clear()

    def _expect_ready(self) -> None:
        if not wait([self._control, self._process.sentinel], _START_S):
            raise OutputError(f"the process that shows the episode did not begin within {_START_S:g} s.")
        try:
            said = self._control.recv()
        except (EOFError, OSError) as error:
            raise OutputError("the process that shows the episode died before it began.") from error
        if said:
            raise OutputError(said)


def _run(job: Job, control: Connection) -> None:
    try:
        # Rerun is imported here, so that the control process has none of its threads.
        from wrenchflow.view.live_process import run_live
    except ModuleNotFoundError as error:
        control.send(f"this needs {error.name}, which is not installed: install wrenchflow[view].")
        return
    run_live(job, control)
