"""A disk that fails at any one operation: an error in one line, nothing that looks whole, and what was sent is saved.

The operations are counted in a run without faults, and then each of them fails once in a run of its own.
"""

import errno
import io
import os
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import OutputError, RecordingError
from wrenchflow.messages import Attachment
from wrenchflow.recording.images import image_messages
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.recover import recover
from wrenchflow.recording.write import write_episode
from wrenchflow.recording.writer import EpisodeWriter
from wrenchflow.signals import POSE, WRENCH

N = 1500
T = np.arange(1, N + 1, dtype=np.int64) * 1_000_000


def episode() -> Episode:
    rng = np.random.default_rng(0)
    streams = {
        "tcp_pose": Stream(T, rng.normal(size=(N, 7)), POSE, "base"),
        "wrench_raw": Stream(T, rng.normal(size=(N, 6)), WRENCH, "sensor"),
    }
    pictures = {"camera/wrist": image_messages(T[::300].copy(), [rng.bytes(9000) for _ in T[::300]], "wrist")}
    attached = {"rig.toml": Attachment(data=rng.bytes(20_000), media_type="application/toml")}
    event = Event(int(T[10]), int(T[90]), "contact", "first")
    return Episode("0001", "t", streams, (event,), {"result": 1}, messages=pictures, attachments=attached)


def whole_at_once(path: Path, episode: Episode) -> None:
    write_episode(path, episode)


def while_it_happens(path: Path, episode: Episode) -> None:
    """As the writer process does: parts, flushed, and synced now and then."""
    with EpisodeWriter(path, id=episode.id, task=episode.task, attachments=episode.attachments) as writer:
        for name, stream in episode.streams.items():
            writer.add_stream(name, stream.signal, stream.frame)
        writer.flush()
        writer.sync()
        for start, stop in pairwise((0, 250, 500, 750, 1000, 1250, 1500)):
            for name, stream in episode.streams.items():
                writer.write(name, stream.t[start:stop], stream.data[start:stop])
            writer.flush()
            if start % 500:
                writer.sync()
        writer.event(episode.events[0])
        writer.finish({"success": True})


@dataclass
class Disk:
    """Counts what is asked of it, and fails where it is told to.

    Attributes:
        fail_at: Number of the operation that fails; None for none.
        error: What it fails with.
        for_good: Whether all that follow fail as well: a disk that is full stays full.
        short: Whether a write puts half of its bytes down before it fails.
    """

    fail_at: int | None = None
    error: int = errno.ENOSPC
    for_good: bool = True
    short: bool = False
    done: int = 0

    def operate(self) -> None:
        number, self.done = self.done, self.done + 1
        if self.fail_at is not None and (number == self.fail_at or (self.for_good and number > self.fail_at)):
            raise OSError(self.error, os.strerror(self.error))


class File(io.FileIO):
    """A file on such a disk, beneath Python's buffer."""

    def __init__(self, path: Path, disk: Disk) -> None:
        super().__init__(path, "w")
        self._disk = disk

    def write(self, content) -> int:
        try:
            self._disk.operate()
        except OSError:
            if self._disk.short and self._disk.done == (self._disk.fail_at or 0) + 1:
                self._disk.short = False
                return super().write(memoryview(content)[: max(1, len(content) // 2)])
            raise
        return super().write(content)

    def close(self) -> None:
        is_open = not self.closed
        super().close()
        if is_open:
            self._disk.operate()


@pytest.fixture
def on_disk(monkeypatch: pytest.MonkeyPatch) -> Callable[[Disk], None]:
    """Let everything that a `Sink` asks of the operating system go through a disk."""
    open_path, rename, open_folder = Path.open, Path.rename, os.open
    sync = {name: getattr(os, name) for name in ("fsync", "fdatasync")}

    def put(disk: Disk) -> None:
        def opened(path: Path, mode: str = "r", *rest, **options):
            if mode != "wb":
                return open_path(path, mode, *rest, **options)
            disk.operate()
            return io.BufferedWriter(File(path, disk))

        def counted[**P, R](work: Callable[P, R]) -> Callable[P, R]:
            def asked(*arguments: P.args, **options: P.kwargs) -> R:
                disk.operate()
                return work(*arguments, **options)

            return asked

        monkeypatch.setattr(Path, "open", opened)
        monkeypatch.setattr(Path, "rename", counted(rename))
        monkeypatch.setattr(os, "open", counted(open_folder))
        for name, work in sync.items():
            monkeypatch.setattr(os, name, counted(work))

    return put


def assert_saved(path: Path, whole: Episode) -> int:
    """Look at what is left; how many samples of it are saved."""
    partial = path.with_name(path.name + ".partial")
    if path.exists():
        # Only the folder's entry could not be synced: the file itself is on the disk.
        assert not partial.exists()
        assert read_episode(path).streams == whole.streams
        return N
    if not partial.exists():
        return 0
    saved = path.with_name("saved.mcap")
    try:
        recover(partial, saved)
    except RecordingError:
        assert not saved.exists()
        return 0
    found = read_episode(saved)
    for name, stream in found.streams.items():
        n = len(stream)
        np.testing.assert_array_equal(stream.t, whole[name].t[:n])
        np.testing.assert_array_equal(stream.data, whole[name].data[:n])
    assert all(attached == whole.attachments[name] for name, attached in found.attachments.items())
    saved.unlink()
    return len(found["tcp_pose"])


@pytest.mark.parametrize("write", [whole_at_once, while_it_happens])
@pytest.mark.parametrize(
    ("error", "for_good", "short"),
    [(errno.ENOSPC, True, False), (errno.ENOSPC, True, True), (errno.EIO, True, False), (errno.EIO, False, False)],
    ids=["full", "full after half a write", "broken", "broken once"],
)
def test_every_operation_of_the_disk_may_fail(tmp_path, on_disk, monkeypatch, write, error, for_good, short):
    whole, clean = episode(), Disk()
    on_disk(clean)
    write(tmp_path / "clean.mcap", whole)
    assert clean.done > 15
    saved = []
    for number in range(clean.done):
        disk, path = Disk(fail_at=number, error=error, for_good=for_good, short=short), tmp_path / f"{number}.mcap"
        on_disk(disk)
        with pytest.raises(OutputError) as told:
            write(path, whole)
        monkeypatch.undo()
        assert str(told.value).count("\n") == 0
        assert os.strerror(error).lower() in str(told.value)
        assert str(path) in str(told.value)
        saved.append(assert_saved(path, whole))
    # The later it happens, the more is saved; at the end all is.
    assert saved == sorted(saved)
    assert (saved[0], saved[-1]) == (0, N)
    assert len(set(saved)) > 3
