"""The last ten seconds of an attempt, whatever ends it: an exception, a signal, or the death of its process.

Rows lie in a file of their own while an attempt lasts (see `row_file`). Where it ends in an exception, whoever runs it
writes a recording of what there is; where the process dies, the stage that started it does, or whoever comes next.
"""

import logging
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import BrokenExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from itertools import chain, count
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from wrenchflow.clock import SECOND_NS
from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import WrenchflowError
from wrenchflow.recording import row_file
from wrenchflow.recording.row_file import is_being_filled, make_row_file, read_row_file
from wrenchflow.recording.write import write_episode
from wrenchflow.source import Source

SUFFIX = ".blackbox.mcap"
KEPT_S = 10.0
_DIED = "the process that ran it died"
_ENDED = "the stage that it was part of ended"


class BlackBox:
    """The black box of one attempt.

        with BlackBox(folder, source, id="0007", task="peg-insertion") as box:
            rows = box.rows(meta, capacity)  # Where the attempt stores its rows.
            box.tell = lambda: attempt.episode("0007", ...)
            ...
            write_episode(path, attempt.episode("0007", ...))

    If the block ends in an exception, the last ten seconds are in `<folder>/<id>.blackbox.mcap`; else nothing is left.

    Attributes:
        tell: Gives the episode so far, with all that is known; without it, what the rows say has to do.
    """

    def __init__(self, folder: Path, source: Source, *, id: str, task: str, meta: Mapping[str, Any]) -> None:
        """Begin without rows.

        Args:
            folder: Of black boxes; made when it is needed.
            source: What a row is.
            id: Name of the episode.
            task: The task that is attempted.
            meta: JSON values that are known before the attempt begins.
        """
        self.tell: Callable[[], Episode] | None = None
        self._folder, self._source, self._id, self._task, self._meta = folder, source, id, task, dict(meta)
        self._path: Path | None = None

    def rows(self, meta: Mapping[str, Any], capacity: int) -> Any:
        """Where the rows of the attempt are to be stored, an array of the source's dtype.

        Args:
            meta: JSON values that are known when the attempt begins.
            capacity: How many rows there may be.

        Raises:
            OutputError: If there is no room for them.
        """
        self._folder.mkdir(parents=True, exist_ok=True)
        # Known before it is there: Ctrl-C may come while it is made.
        self._path = self._folder / f"{self._id}{row_file.SUFFIX}"
        known = {**self._meta, **meta}
        return make_row_file(self._path, self._source, capacity, id=self._id, task=self._task, meta=known)

    def __enter__(self) -> "BlackBox":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._path is None or not self._path.exists():
            return
        if error is not None:
            try:
                episode = self._told(error) or read_row_file(self._path)
                if episode.streams:
                    _write(self._folder, episode, f"{type(error).__name__}: {error}".removesuffix(": "))
            except (WrenchflowError, OSError) as problem:
                error.add_note(f"The black box of {self._id} could not be written: {problem}")
                return  # The rows stay where they are.
        self._path.unlink(missing_ok=True)

    def _told(self, error: BaseException) -> Episode | None:
        try:
            return self.tell() if self.tell is not None else None
        except Exception as problem:  # Whatever it is: the attempt may have been torn in half by what ended it.
            error.add_note(f"The black box of {self._id} has nothing but rows: {problem}")
            return None


@contextmanager
def black_boxes(out: Path) -> Iterator[Path]:
    """The folder for the black boxes of a stage that writes `out`: beside it, for a stage that failed leaves nothing.

    What an earlier run left that was killed is saved first, and it is told where boxes of earlier runs are. If the
    block ends in an exception, whatever processes that died in it left is saved too, and the exception is given a note
    that says where it all is.

    Args:
        out: The folder that the stage writes.

    Yields:
        The folder; it is there while there is something in it.
    """
    folder = out.with_name(f"{out.name}.blackbox")
    _save_left(folder, _DIED)
    before = set(folder.glob(f"*{SUFFIX}"))
    if before:
        told = "'%s' holds %d of earlier runs' black boxes; it is not needed for anything else."
        logging.getLogger("wrenchflow").warning(told, folder, len(before))
    try:
        yield folder.resolve()  # Workers may be elsewhere.
    except BaseException as error:
        # Of Ctrl-C and the like the workers die that are under way; of a worker's own death nobody knows more.
        is_end = not isinstance(error, BrokenExecutor)
        _save_left(folder, f"{_ENDED}: {type(error).__name__}: {error}".removesuffix(": ") if is_end else _DIED)
        written = sorted(set(folder.glob(f"*{SUFFIX}")) - before)
        if len(written) == 1:
            error.add_note(f"The black box is '{written[0]}'.")
        elif written:
            error.add_note(f"The black boxes of {len(written)} attempts are in '{folder}'.")
        if left := sorted(folder.glob(f"*{row_file.SUFFIX}")):
            error.add_note(f"Rows of {len(left)} more are in '{folder}': `wrenchflow recover {left[0]}`, for one.")
        raise
    finally:
        with suppress(OSError):  # It holds something, or was never made.
            folder.rmdir()


def _save_left(folder: Path, why: str) -> None:
    """Make black boxes of the rows that dead processes left; what cannot be read or written stays as it is."""
    for path in sorted(folder.glob(f"*{row_file.SUFFIX}")):
        with suppress(WrenchflowError, OSError):
            if not is_being_filled(path):
                episode = read_row_file(path)
                if episode.streams:
                    _write(folder, episode, why)
                path.unlink()
    for path in folder.glob(f"*{row_file.SUFFIX}.partial"):  # Whoever made it did not come to the first row.
        with suppress(OSError):  # It was whole a moment later.
            if not is_being_filled(path):
                path.unlink()


def _write(folder: Path, episode: Episode, why: str) -> None:
    """Write the end of an episode under a name that is free: a black box never takes the place of another one."""
    names = (f"{episode.id}{number}{SUFFIX}" for number in chain([""], (f"-{k}" for k in count(2))))
    write_episode(next(path for name in names if not (path := folder / name).exists()), _end_of(episode, why))


def _end_of(episode: Episode, why: str) -> Episode:
    """The last ten seconds of an episode that was cut off, with the reason as its result."""
    stop_ns = episode.span_ns[1]
    start_ns = stop_ns - round(KEPT_S * SECOND_NS)
    lasting = [event for event in episode.events if event.kind not in ("success", "failure")]
    return replace(
        episode,
        streams={name: _end(stream, start_ns) for name, stream in episode.streams.items()},
        events=(*lasting, Event(stop_ns, stop_ns, "failure", why)),
        meta={**episode.meta, "result": {"success": False, "failure": why}},
    )


def _end(stream: Stream, start_ns: int) -> Stream:
    """The samples from `start_ns` on; of a stream that changes seldom, what held then."""
    first = min(int(np.searchsorted(stream.t, start_ns)), max(len(stream) - 1, 0))
    return replace(stream, t=stream.t[first:], data=stream.data[first:])
