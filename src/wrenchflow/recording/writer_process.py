"""The process that writes a recording while it happens: it drains the rings, encodes, compresses, and minds the disk.

It never speaks to the control loop but through the rings. If the control process dies, what waits in the rings is still
written, and the file is completed and says so; if this one dies, the file stays `.partial` with all but the last chunk.
"""

import multiprocessing
import os
import signal
import time
from collections.abc import Mapping
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

import numpy as np

from wrenchflow.episode import Event
from wrenchflow.errors import WrenchflowError
from wrenchflow.recording.ring import Ring
from wrenchflow.recording.writer import EpisodeWriter
from wrenchflow.source import Source, T, samples_of

EVENT = np.dtype([("start_ns", "i8"), ("stop_ns", "i8"), ("kind", "S32"), ("label", "S96")], align=True)
EVENT_CAPACITY = 256
_POLL_S = 0.02
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
        rings: Name of each source's ring, then that of the events.
    """

    path: Path
    id: str
    task: str
    meta: Mapping[str, Any]
    compression: str
    sources: tuple[Source, ...]
    rings: tuple[str, ...]


def run_writer(job: Job, control: Connection) -> None:
    """Write until told to finish, or until nobody is there who could tell."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the control process, which then tells us.
    parent = multiprocessing.parent_process()
    assert parent is not None
    try:
        writing = _Writing(job)
    except (WrenchflowError, OSError) as error:
        control.send(str(error))
        return
    try:
        writing.drain()  # Nothing is there yet, but what it takes is compiled now, and not while rows wait.
        control.send("")  # Ready.
        said: Any = None
        is_behind = False
        while said is None:
            ready = wait([control, parent.sentinel], 0.0 if is_behind else _POLL_S)
            if control in ready:
                said = _receive(control)
            elif ready:
                said = _DIED
            is_behind = writing.drain()
        writing.finish(said)
        _send(control, "")
    except (WrenchflowError, OSError) as error:
        _send(control, str(error))
    finally:
        writing.close(unlink=not parent.is_alive())
    # All is on the disk and everybody knows. Taking the interpreter down in order takes a quarter of a second, and
    # `finish` would wait for that.
    os._exit(0)


_DIED = {"success": False, "failure": "the control process died"}


def _receive(control: Connection) -> Any:
    try:
        return control.recv()
    except (EOFError, OSError):
        return _DIED


def _send(control: Connection, text: str) -> None:
    try:
        control.send(text)
    except OSError:
        return  # Nobody is there to be told.


class _Writing:
    """The file and the rings."""

    def __init__(self, job: Job) -> None:
        self._sources = job.sources
        self._rings = [
            *(
                Ring.attach(name, source.dtype, source.capacity)
                for name, source in zip(job.rings, job.sources, strict=False)
            ),
            Ring.attach(job.rings[-1], EVENT, EVENT_CAPACITY),
        ]
        self._writer = EpisodeWriter(job.path, id=job.id, task=job.task, meta=job.meta, compression=job.compression)
        for source in job.sources:
            for column in source.columns:
                self._writer.add_stream(column.name, column.signal, column.frame)
        self._writer.flush()
        self._writer.sync()  # Schemas, channels and metadata are in the file before anything happens.
        self._counts = {source.name: _Count() for source in job.sources}
        self._chunk_start_ns: int | None = None
        self._synced_s = time.monotonic()

    def drain(self) -> bool:
        """Write what waits; end a chunk that is old enough, and sync now and then. True where a ring was half full."""
        newest_ns = 0
        is_behind = False
        for source, ring in zip(self._sources, self._rings[:-1], strict=True):
            rows = ring.take()
            is_behind |= len(rows) > ring.capacity // 2
            if len(rows):
                count = self._counts[source.name]
                count.see(rows[T])
                for column in source.columns:
                    samples = samples_of(rows, column, count.start_ns)
                    self._writer.write(
                        column.name, samples.t, samples.data, received=samples.received, sequence=samples.sequence
                    )
                newest_ns = max(newest_ns, int(rows[T][-1]))
                if self._chunk_start_ns is None:
                    self._chunk_start_ns = int(rows[T][0])
        for row in self._rings[-1].take():
            kind, label = bytes(row["kind"]).decode(), bytes(row["label"]).decode()
            self._writer.event(Event(int(row["start_ns"]), int(row["stop_ns"]), kind, label))
        if self._chunk_start_ns is not None and newest_ns - self._chunk_start_ns >= _CHUNK_NS:
            self._writer.flush()
            self._chunk_start_ns = None
        if time.monotonic() - self._synced_s > _SYNC_S:
            self._writer.sync()
            self._synced_s = time.monotonic()
        return is_behind

    def finish(self, result: Any) -> None:
        """Write what still waits, and complete the file."""
        self.drain()
        recorded = {
            source.name: self._counts[source.name].said() | {"dropped": ring.dropped}
            for source, ring in zip(self._sources, self._rings[:-1], strict=True)
        }
        recorded["events"] = {"dropped": self._rings[-1].dropped}
        self._writer.finish(result, recorded)

    def close(self, *, unlink: bool) -> None:
        """Let go of file and rings; where whoever made the rings is no more, they end with us."""
        self._writer.close()
        for ring in self._rings:
            ring.close()
            if unlink:
                ring.unlink()


class _Count:
    """How regularly a source's rows come: gaps against the median of its first hundred periods, and jitter."""

    def __init__(self) -> None:
        self.start_ns = 0
        self._rows = self._gaps = 0
        self._last_ns: int | None = None
        self._first: list[int] = []
        self._sum = self._squares = 0.0
        self._longest_ns = 0

    def see(self, t: np.ndarray) -> None:
        if self._last_ns is None:
            self.start_ns = int(t[0])
        stamps = t if self._last_ns is None else np.concatenate(([self._last_ns], t))
        between = np.diff(stamps)
        self._first += between[: 100 - len(self._first)].tolist()
        is_gap = between > 1.5 * np.median(self._first) if self._first else np.zeros(0, bool)
        regular = between[~is_gap].astype(float)
        self._gaps += int(is_gap.sum())
        self._sum += regular.sum()
        self._squares += (regular**2).sum()
        self._longest_ns = max(self._longest_ns, int(between.max(initial=0)))
        self._rows += len(t)
        self._last_ns = int(t[-1])

    def said(self) -> dict[str, Any]:
        """Plain figures."""
        n = max(self._rows - 1 - self._gaps, 1)
        mean = self._sum / n
        return {
            "rows": self._rows,
            "gaps": self._gaps,
            "longest_s": self._longest_ns * 1e-9,
            "jitter_s": max(self._squares / n - mean**2, 0.0) ** 0.5 * 1e-9,
        }


def event_row(event: Event) -> np.ndarray:
    """An event as a row of the events' ring; a label that is too long is cut."""
    row = np.zeros(1, EVENT)
    row["start_ns"], row["stop_ns"] = event.start_ns, event.stop_ns
    row["kind"], row["label"] = _cut(event.kind, 32), _cut(event.label, 96)
    return row


def _cut(text: str, size: int) -> bytes:
    return text.encode()[:size].decode(errors="ignore").encode()
