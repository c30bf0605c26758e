"""Whatever a file holds: an episode, a recovered prefix or one line that says what is wrong; no hang, no flood.

The mutations come from a seed; a process of its own works through them, so that its memory can be looked at.
"""

import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import WrenchflowError
from wrenchflow.recording.reader import read_episode, read_info
from wrenchflow.recording.recover import recover
from wrenchflow.recording.write import write_episode
from wrenchflow.signals import JOY, POSE

MOST_BYTES = 512 * 2**20


def small(folder: Path) -> bytes:
    """A file with two streams and an event, of a few kilobytes."""
    rng, t = np.random.default_rng(0), np.arange(1, 13) * 1_000_000
    joy = np.hstack((np.zeros((12, 6)), rng.integers(0, 2, (12, 2)).astype(float)))
    streams = {"tcp_pose": Stream(t, rng.normal(size=(12, 7)), POSE, "base"), "joy": Stream(t, joy, JOY, "device")}
    write_episode(folder / "small.mcap", Episode("a", "t", streams, (Event(10**6, 2 * 10**6, "phase", "p"),), {}))
    return (folder / "small.mcap").read_bytes()


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """One to four of: a flipped bit, a wild number, bytes cut out, put in, or copied to another place; a cut end."""
    data = bytearray(content)
    for _ in range(rng.integers(1, 5)):
        at = int(rng.integers(0, len(data)))
        match rng.integers(0, 6):
            case 0:
                data[at] ^= 1 << int(rng.integers(0, 8))
            case 1:
                wild = (0, 1, 2**31, 2**32 - 1, 2**40, 2**63, 2**64 - 1)[rng.integers(0, 7)]
                data[at : at + 8] = wild.to_bytes(8, "little")
            case 2:
                del data[at : at + int(rng.integers(1, 64))]
            case 3:
                data[at:at] = rng.bytes(int(rng.integers(1, 64)))
            case 4:
                start, size = int(rng.integers(0, len(data))), int(rng.integers(1, 256))
                data[at:at] = data[start : start + size]
            case _:
                del data[max(at, 16) :]
        if not data:
            return b""
    return bytes(data)


def outcome(path: Path) -> tuple[int, int]:
    """1 for what was read and for what was recovered, else 0; anything but an error of ours comes through."""
    counts = []
    for work in (lambda: (read_info(path), read_episode(path)), lambda: recover(path, path.with_name("saved.mcap"))):
        try:
            work()
            counts.append(1)
        except WrenchflowError as error:
            counts.append(0)
            lines = str(error).count("\n") + 1
        else:
            lines = 1
        assert lines == 1
    path.with_name("saved.mcap").unlink(missing_ok=True)
    return counts[0], counts[1]


def work_through(folder: Path, seed: int, count: int) -> str:
    content, path, rng = small(folder), folder / "mutated.mcap", np.random.default_rng(seed)
    assert outcome(folder / "small.mcap") == (1, 1)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    sums = np.zeros(2, int)
    for number in range(count):
        path.write_bytes(mutated(content, rng))
        try:
            sums += outcome(path)
        except BaseException:
            sys.stderr.write(f"mutation {number} of seed {seed}\n")
            raise
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    return f"{sums[0]} {sums[1]} {grown}"


@pytest.mark.parametrize("count", [1_000, pytest.param(30_000, marks=pytest.mark.slow)])
def test_mutated_files_are_told_apart_or_refused(tmp_path, count):
    command = [sys.executable, __file__, str(tmp_path), str(count)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert ran.returncode == 0, ran.stderr[-3000:]
    read, recovered, grown = map(int, ran.stdout.split())
    assert grown < MOST_BYTES
    # The mutations are worth something only if they break most files and leave something to save in many.
    assert read < 0.2 * count
    assert recovered > 0.2 * count


if __name__ == "__main__":
    sys.stdout.write(work_through(Path(sys.argv[1]), 0, int(sys.argv[2])))
