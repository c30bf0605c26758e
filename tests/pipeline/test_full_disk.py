"""A recording onto a file system that is full: the loop goes on, the error is told, and what was written is saved.

The file system is a tmpfs of a few hundred kilobytes, mounted where nobody else sees it; a script records onto it.
"""

import json
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from wrenchflow.errors import OutputError
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.recorder import Recorder
from wrenchflow.recording.recover import recover
from wrenchflow.signals import POSE, WRENCH
from wrenchflow.source import Column, Source

ROW = np.dtype([("t_ns", "i8"), ("pose", "f8", (7,)), ("wrench", "f8", (6,))], align=True)
CONTROL = Source(
    name="control",
    dtype=ROW,
    columns=(Column(name="pose", signal=POSE, frame="base"), Column(name="wrench", signal=WRENCH, frame="sensor")),
    capacity=1024,
)
COUNT = 6000
BEFORE, NEVER, NOT_A_BYTE = -2, -1, -3


def sent() -> np.ndarray:
    rows, rng = np.zeros(COUNT, ROW), np.random.default_rng(0)
    rows["t_ns"] = 1_700_000_000_000_000_000 + np.arange(COUNT) * 1_000_000
    rows["pose"], rows["wrench"] = rng.normal(size=(COUNT, 7)), rng.normal(size=(COUNT, 6))
    return rows


def record(disk: Path, ballast_after: int) -> None:
    """Record, fill the disk meanwhile, and print what came of it."""
    rows, path, saved = sent(), disk / "e.mcap", disk.parent / "saved.mcap"
    said: dict[str, object] = {"error": "", "pushed": 0, "looks_whole": False}
    try:
        if ballast_after == BEFORE:
            fill(disk)
        recorder = Recorder(path, id="7", task="t", sources=[CONTROL])
        for number in range(COUNT):
            if number == ballast_after:
                fill(disk)
            if ballast_after == NOT_A_BYTE and number == COUNT // 2:
                limit = path.with_name("e.mcap.partial").stat().st_size
                resource.prlimit(recorder.writer_pid, resource.RLIMIT_FSIZE, (limit, limit))
            recorder.push("control", rows[number : number + 1])
            time.sleep(0.0002)
            said["pushed"] = number + 1
        said |= {"alive": recorder.is_alive, "dropped": recorder.dropped}
        recorder.finish({"success": True})
    except OutputError as error:
        said["error"] = str(error)
    said["left"] = sorted(entry.name for entry in disk.iterdir())
    partial = path.with_name("e.mcap.partial")
    if partial.exists() and partial.stat().st_size:
        recover(partial, saved)
        pose = read_episode(saved)["pose"]
        np.testing.assert_array_equal(pose.data, rows["pose"][: len(pose)])
        said["saved"] = len(pose)
    sys.stdout.write(json.dumps(said))


def fill(disk: Path) -> None:
    try:
        with (disk / "ballast").open("wb", buffering=0) as file:
            while True:
                file.write(bytes(4096))
    except OSError:
        return


@pytest.fixture
def recorded(tmp_path):
    def run(size: str, ballast_after: int = NEVER) -> dict:
        disk = tmp_path / "disk"
        disk.mkdir()
        alone = ("unshare", "--mount", "sh", "-c", f'mount -t tmpfs -o size={size} tmpfs "{disk}" && exec "$@"', "sh")
        try:
            subprocess.run([*alone, "true"], check=True, capture_output=True)
        except (OSError, subprocess.CalledProcessError):
            pytest.skip("this machine lets us mount nothing")
        command = [*alone, sys.executable, __file__, str(disk), str(ballast_after)]
        ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
        assert (ran.returncode, ran.stderr) == (0, "")
        return json.loads(ran.stdout)

    return run


@pytest.mark.parametrize(
    ("size", "ballast_after"),
    [
        pytest.param("64k", NEVER, marks=pytest.mark.slow),
        ("400k", NEVER),
        pytest.param("16m", 3000, marks=pytest.mark.slow),
    ],
)
def test_a_disk_that_fills_up_is_told_and_the_loop_goes_on(recorded, size, ballast_after):
    said = recorded(size, ballast_after)
    assert "no space left on device" in said["error"]
    assert "\n" not in said["error"]
    # The loop stored or dropped every row, with the writer or without it, and could know that there was none.
    assert said["pushed"] == COUNT
    assert said["dropped"] > 0
    assert said["alive"] is False
    assert "e.mcap" not in said["left"]
    assert "e.mcap.partial" in said["left"]
    assert said["saved"] >= (0 if size == "64k" else 1000)


def test_a_disk_that_is_full_from_the_start_is_told_at_once(recorded):
    said = recorded("64k", BEFORE)
    assert "no space left on device" in said["error"]
    assert said["pushed"] == 0
    assert "e.mcap" not in said["left"]


def test_a_disk_that_is_full_at_the_very_end_is_told(recorded):
    said = recorded("16m", COUNT - 1)
    assert "no space left on device" in said["error"]
    assert said["pushed"] == COUNT
    assert "e.mcap" not in said["left"]
    assert said["saved"] >= COUNT - 1000


def test_a_writer_that_cannot_even_close_its_file_says_so_and_nothing_else(tmp_path):
    """Not one byte more fits: what Python still buffers cannot be put down when the file is closed either."""
    (tmp_path / "disk").mkdir()
    command = [sys.executable, __file__, str(tmp_path / "disk"), str(NOT_A_BYTE)]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert (ran.returncode, ran.stderr) == (0, "")
    said = json.loads(ran.stdout)
    assert "file too large" in said["error"]
    assert (said["pushed"], said["alive"], said["left"]) == (COUNT, False, ["e.mcap.partial"])
    assert said["saved"] >= 1000


if __name__ == "__main__":
    record(Path(sys.argv[1]), int(sys.argv[2]))
