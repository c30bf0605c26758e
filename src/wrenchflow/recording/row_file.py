"""Rows in a file that outlives whoever stores them: memory that is mapped to it, and an episode from what is left.

A row that was stored belongs to the operating system, which keeps it whatever becomes of the process; only where the
machine itself dies are the last seconds lost. Nothing is encoded and nothing is called: a row is stored in memory.
"""

import fcntl
import json
import mmap
import os
import struct
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

from wrenchflow.episode import Episode, Stream
from wrenchflow.errors import OutputError, RecordingError, StreamError
from wrenchflow.ledger import Ledger
from wrenchflow.recording.container import map_file
from wrenchflow.recording.file_format import signal_of
from wrenchflow.source import Column, Source, T, samples_of

MAGIC = b"WRENCHROWS1\n"
SUFFIX = ".rows"
_LENGTH = struct.Struct("<Q")
_START = len(MAGIC) + _LENGTH.size
_PAGE = 4096
_ZEROS = bytes(1 << 20)
_WRITTEN_ROWS = 10_000


def make_row_file(
    path: Path, source: Source, capacity: int, *, id: str, task: str, meta: Mapping[str, Any]
) -> np.ndarray:
    """Make a file of rows, with room for all of them: nothing is lost if the disk fills up later.

    Args:
        path: Where it goes; one that is there is replaced.
        source: What a row is. No stamp is zero.
        capacity: How many rows there may be.
        id: Name of the episode.
        task: The task that is attempted.
        meta: JSON values that are known at the start.

    Returns:
        All of its rows, zero where nothing was stored yet. Shape (capacity,).

    Raises:
        OutputError: If there is no room, or the folder cannot be written to.
    """
    columns = [asdict(column) for column in source.columns]
    head = {"id": id, "task": task, "meta": dict(meta), "columns": columns}
    text = json.dumps({**head, "dtype": npy.dtype_to_descr(source.dtype)}).encode()
    offset = _offset(len(text))
    size = offset + capacity * source.dtype.itemsize
    partial = path.with_name(path.name + ".partial")
    try:
        with partial.open("w+b") as file:
            # The mapping holds the lock for as long as it lives: who finds the file until then lets it be.
            fcntl.flock(file, fcntl.LOCK_EX)
            # The first rows are written and not only reserved: to touch a page first costs a tenth where it is
            # there already. Of an attempt that may last a minute most rows are never used.
            reserves = hasattr(os, "posix_fallocate")
            written = min(size, offset + _WRITTEN_ROWS * source.dtype.itemsize) if reserves else size
            for start in range(0, written, len(_ZEROS)):
                file.write(_ZEROS[: written - start])
            file.flush()
            if reserves:
                os.posix_fallocate(file.fileno(), 0, size)
            file.seek(0)
            file.write(MAGIC + _LENGTH.pack(len(text)) + text)
            file.flush()
            memory = mmap.mmap(file.fileno(), size)
        os.replace(partial, path)
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise OutputError(f"{path} cannot be made, with room for {size} bytes: {why}.") from error
    finally:
        partial.unlink(missing_ok=True)
    return np.frombuffer(memory, source.dtype, capacity, offset)


def is_being_filled(path: Path) -> bool:
    """Whether whoever fills a file of rows still lives."""
    with path.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def read_row_file(path: Path) -> Episode:
    """The episode that a file of rows holds. Its last row is left out, for it may be half.

    Args:
        path: A file that nobody fills any more.

    Returns:
        Its streams, what they say of the safety layer, and what was known at the start; no streams where no row is
        whole.

    Raises:
        RecordingError: If it is no such file.
    """
    data = map_file(path)
    if data[: len(MAGIC)] != MAGIC:
        raise RecordingError(f"{path} is not a file of rows: it starts with {bytes(data[:8]).hex() or 'nothing'}.")
    try:
        (length,) = _LENGTH.unpack_from(data, len(MAGIC))
        head = json.loads(bytes(data[_START : _START + length]))
        dtype = npy.descr_to_dtype([(name, kind, *map(tuple, shape)) for name, kind, *shape in head["dtype"]])
        rows: np.ndarray = np.frombuffer(data, dtype, offset=_offset(length))
        rows = rows[: max(int(np.count_nonzero(rows[T])) - 1, 0)]
        streams = {}
        for of in head["columns"] if len(rows) else ():
            column = Column(**{**of, "signal": signal_of(of["signal"])})
            samples = samples_of(rows, column, int(rows[T][0]))
            streams[column.name] = Stream(samples.t.copy(), samples.data.copy(), column.signal, column.frame)
        episode = Episode(head["id"], head["task"], streams, (), head["meta"])
        ledger = Ledger.of(episode)
        return episode.with_events(*ledger.events).with_meta(safety=ledger.summary()) if ledger else episode
    except (KeyError, TypeError, ValueError, struct.error, StreamError) as error:
        raise RecordingError(f"{path} is a damaged file of rows ({error}).") from error


def _offset(length: int) -> int:
    """Where the rows begin after a head of that length: at the next page."""
    return -(-(_START + length) // _PAGE) * _PAGE
