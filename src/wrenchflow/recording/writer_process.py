"""The process that writes a recording while it happens: it drains the rings, encodes, compresses, and minds the disk.

It never speaks to the control loop but through the rings. If the control process dies, what waits in the rings is still
written, and the file is completed and says so; if this one dies, the file stays `.partial` with all but the last chunk.
"""

import math
import multiprocessing
import os
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import numpy as np

from wrenchflow.camera import View
from wrenchflow.clock import SECOND_NS, Clock
from wrenchflow.episode import Event
from wrenchflow.errors import OutputError, WrenchflowError
from wrenchflow.messages import Attachment, Messages
from wrenchflow.recording import codec, schemas
from wrenchflow.recording.camera_process import PICTURES_WAITING
from wrenchflow.recording.child import leave_signals_to_parent
from wrenchflow.recording.file_format import CLOCK_SYNC
from wrenchflow.recording.images import image_messages
from wrenchflow.recording.regularity import Regularity
from wrenchflow.recording.ring import TAP_ROWS, Ring
from wrenchflow.recording.writer import EpisodeWriter
from wrenchflow.source import OFFSET, RECEIVED, SEQUENCE, Source, T, samples_of

EVENT = np.dtype([("start_ns", "i8"), ("stop_ns", "i8"), ("kind", "S32"), ("label", "S96")], align=True)
EVENT_CAPACITY = 4096  # All events of an episode may be told at its end, at once.
_POLL_S = 0.02
_ROWS = 1024  # Taken at once: what is written of them stays in a fast cache, and in memory that was touched before.
_SYNC_S = 1.0
# While it happens a chunk holds a quarter of a second: what dies with this process. It ends at the look that finds it
# this old, for the next look would come too late.
_CHUNK_NS = 250_000_000 - round(_POLL_S * 1e9)


@dataclass(frozen=True, kw_only=True)
class Job:
    """What is written, and where it comes from; travels to the writer process.

    Attributes:
        path: The finished file.
        id: Name of the episode.
        task: The task that is attempted.
        meta: JSON values that are known at the start.
        compression: Of the chunks.
        sources: What is recorded.
        views: What cameras see.
        taps: Name of a ring, by source, that gets the source's rows too.
        rings: Name of each source's ring, then of each view's, then that of the events.
        clock: That all stamps are of.
        attachments: Files that the recording carries.
    """

    path: Path
    id: str
    task: str
    meta: Mapping[str, Any]
    compression: str
    sources: tuple[Source, ...]
    views: tuple[View, ...]
    taps: Mapping[str, str]
    rings: tuple[str, ...]
    clock: Clock
    attachments: Mapping[str, Attachment]


def run_writer(job: Job, control: Connection) -> None:
    """Write until told to finish, or until nobody is there who could tell."""
    leave_signals_to_parent()
    parent = multiprocessing.parent_process()
    assert parent is not None
    try:
        writing = _Writing(job)
    except (WrenchflowError, OSError) as error:
        control.send(str(error))
        return
    try:
        writing.drain()  # Nothing is there yet, but what it takes is compiled now, and not while rows wait.
        control.send({})  # Ready.
        end: _End | None = None
        is_behind = False
        while end is None:
            ready = wait([control, parent.sentinel], 0.0 if is_behind else _POLL_S)
            if control in ready:
                end = _receive(control)
            elif ready:
                end = _DIED
            is_behind = writing.drain()
        _send(control, writing.finish(*end))
    except (WrenchflowError, OSError) as error:
        _send(control, str(error))
    finally:
        writing.close(unlink=not parent.is_alive())
    # All is on the disk and everybody knows. Taking the interpreter down in order takes a quarter of a second, and
    # `finish` would wait for that.
    os._exit(0)


# What came of the episode, what the safety layer did, and what went wrong with which camera.
_End = tuple[Any, Any, Mapping[str, str]]
DIED = "the control process died"  # What a recording fails by that its writer completed alone.
_DIED: _End = ({"success": False, "failure": DIED}, None, {})


def _receive(control: Connection) -> _End:
    try:
        return control.recv()
    except (EOFError, OSError):
        return _DIED


def _send(control: Connection, said: str | dict[str, Any]) -> None:
    """Say what went wrong, or what was recorded."""
    try:
        control.send(said)
    except OSError:
        return  # Nobody is there to be told.


class _Writing:
    """The file and the rings."""

    def __init__(self, job: Job) -> None:
        kinds = [(source.dtype, source.capacity) for source in job.sources]
        kinds += [(view.row, PICTURES_WAITING) for view in job.views]
        kinds.append((EVENT, EVENT_CAPACITY))
        rings = [Ring.attach(name, *kind) for name, kind in zip(job.rings, kinds, strict=True)]
        self._rings = rings
        self._taps = {
            source.name: Ring.attach(job.taps[source.name], source.dtype, TAP_ROWS)
            for source in job.sources
            if source.name in job.taps
        }
        self._sources = list(zip(job.sources, rings, strict=False))
        self._views = list(zip(job.views, rings[len(job.sources) :], strict=False))
        self._events = rings[-1]
        self._clock = job.clock
        self._writer = EpisodeWriter(
            job.path,
            id=job.id,
            task=job.task,
            meta=job.meta,
            compression=job.compression,
            attachments=job.attachments,
        )
        for source in job.sources:
            for column in source.columns:
                self._writer.add_stream(column.name, column.signal, column.frame)
        for view in job.views:
            self._writer.add_messages(view.frame, schemas.message_type(schemas.IMAGE_MESSAGE))
        self._writer.add_messages(CLOCK_SYNC, schemas.message_type(schemas.CLOCK_MESSAGE))
        self._writer.flush()
        self._writer.sync()  # Schemas, channels and metadata are in the file before anything happens.
        self._counts = {of.name: Regularity() for of in (*job.sources, *job.views)}
        self._offsets: dict[str, tuple[int, int]] = {}
        self._n_syncs = 0
        self._chunk_start_ns: int | None = None
        self._synced_s = -math.inf

    def drain(self) -> bool:
        """Write what waits; end a chunk that is old enough, and sync now and then. True where more waits."""
        newest_ns = 0
        is_behind = False
        for source, ring in self._sources:
            rows = ring.take(_ROWS)
            is_behind |= len(rows) == _ROWS
            if len(rows):
                self._write(source, rows)
                newest_ns = self._aged(rows, newest_ns)
        for view, ring in self._views:
            rows = ring.take()
            if len(rows):
                newest_ns = self._aged(rows, newest_ns)
                self._counts[view.name].see(rows)
                pictures = [row["data"][: row["size"]] for row in rows]
                images = image_messages(rows[T], pictures, view.frame, received=rows[RECEIVED], sequence=rows[SEQUENCE])
                self._writer.write_messages(view.frame, images)
        for row in self._events.take():
            kind, label = bytes(row["kind"]).decode(), bytes(row["label"]).decode()
            self._writer.event(Event(int(row["start_ns"]), int(row["stop_ns"]), kind, label))
        if self._chunk_start_ns is not None and newest_ns - self._chunk_start_ns >= _CHUNK_NS:
            self._writer.flush()
            self._chunk_start_ns = None
        if time.monotonic() - self._synced_s > _SYNC_S:
            self._synchronise()
            self._writer.sync()
            self._synced_s = time.monotonic()
        return is_behind

    def _aged(self, rows: np.ndarray, newest_ns: int) -> int:
        """The newest stamp so far; the first one after a chunk's end is the start of the next."""
        if self._chunk_start_ns is None:
            self._chunk_start_ns = int(rows[T][0])
        return max(newest_ns, int(rows[T][-1]))

    def _write(self, source: Source, rows: np.ndarray) -> None:
        if source.name in self._taps:
            for number in range(len(rows)):
                self._taps[source.name].push(rows[number : number + 1])
        count = self._counts[source.name]
        count.see(rows)
        for column in source.columns:
            samples = samples_of(rows, column, count.start_ns)
            self._writer.write(
                column.name, samples.t, samples.data, received=samples.received, sequence=samples.sequence
            )
        if OFFSET in (source.dtype.names or ()):
            self._offsets[source.name] = int(rows[T][-1]), int(rows[OFFSET][-1])

    def _synchronise(self) -> None:
        """Note what other clocks show: the system's, which may be set, and those of sources that have their own."""
        shown = [("system", self._clock.now_ns(), time.time_ns())]
        shown += [(name, t, t - offset) for name, (t, offset) in self._offsets.items()]
        payloads = tuple(
            codec.encode(
                schemas.CLOCK_MESSAGE, {"header": {"stamp": _time(t)}, "time_ref": _time(other), "source": source}
            )
            for source, t, other in shown
        )
        t, now_ns = np.array([t for _, t, _ in shown]), self._clock.now_ns()
        numbers = np.arange(self._n_syncs, self._n_syncs + len(t))
        self._n_syncs += len(t)
        clock_type = schemas.message_type(schemas.CLOCK_MESSAGE)
        self._writer.write_messages(CLOCK_SYNC, Messages(clock_type, t, np.full(len(t), now_ns), numbers, payloads))

    def finish(self, result: Any, safety: Any, problems: Mapping[str, str]) -> dict[str, Any]:
        """Write what still waits, complete the file, and return what it says of each source."""
        while self.drain():
            continue
        self._synchronise()
        recorded = {
            of.name: self._counts[of.name].said() | {"dropped": ring.dropped}
            for of, ring in (*self._sources, *self._views)
        }
        recorded["events"] = {"dropped": self._events.dropped}
        for name, problem in problems.items():
            recorded.setdefault(name, {})["problem"] = problem
        self._writer.finish(result, recorded, safety)
        return recorded

    def close(self, *, unlink: bool) -> None:
        """Let go of file and rings; where whoever made the rings is no more, they end with us."""
        with suppress(OutputError):  # What kept us from finishing was told, and may keep us from closing.
            self._writer.close()
        for tap in self._taps.values():
            tap.close()
        for ring in self._rings:
            ring.close()
            if unlink:
                ring.unlink()


def _time(t_ns: int) -> dict[str, int]:
    seconds, nanoseconds = divmod(t_ns, SECOND_NS)
    return {"sec": seconds, "nanosec": nanoseconds}


def event_row(event: Event) -> np.ndarray:
    """An event as a row of the events' ring; a label that is too long is cut."""
    row = np.zeros(1, EVENT)
    row["start_ns"], row["stop_ns"] = event.start_ns, event.stop_ns
    row["kind"], row["label"] = _cut(event.kind, 32), _cut(event.label, 96)
    return row


def _cut(text: str, size: int) -> bytes:
    return text.encode()[:size].decode(errors="ignore").encode()
