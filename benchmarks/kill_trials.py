"""Killed with SIGKILL at a random moment, the writer or the control process: what is lost, and is what is left true?

uv run python benchmarks/kill_trials.py [TRIALS]

A control process records 1000 rows a second. In every second trial it is killed, in the others its writer. What was
sent until then is known from a counter outside; what is read afterwards (after `recover`, where the writer died) has to
be equal to it, bit for bit, as far as it goes.
"""

import mmap
import os
import random
import signal
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np

from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.recorder import Recorder
from wrenchflow.recording.recover import recover
from wrenchflow.signals import JOINTS, POSE, WRENCH
from wrenchflow.source import Column, Source

TRIALS, GOAL_S = 50, 0.3
EPOCH_NS = 1_700_000_000_000_000_000
ROW = np.dtype(
    [("t_ns", "i8"), ("sequence", "i8"), ("joints", "f8", (21,)), ("pose", "f8", (7,)), ("wrench", "f8", (6,))],
    align=True,
)
SOURCE = Source(
    name="control",
    dtype=ROW,
    columns=(
        Column(name="joints", signal=JOINTS),
        Column(name="pose", signal=POSE, frame="base"),
        Column(name="wrench", signal=WRENCH, frame="sensor"),
    ),
)


def fill(row: np.ndarray, number: int) -> None:
    """The row of a number, which a reader can make again."""
    row["t_ns"], row["sequence"] = EPOCH_NS + number * 1_000_000, number
    values = np.sin(np.arange(34) + 0.001 * number)
    row["joints"], row["pose"], row["wrench"] = values[:21], values[21:28], values[28:]


def control(folder: Path) -> None:
    """Record for ever, at 1 kHz; the counter and the writer's number stand in a file that survives."""
    with (folder / "state").open("r+b") as file:
        state = mmap.mmap(file.fileno(), 16)
    recorder = Recorder(folder / "e.mcap", id="e", task="kill", sources=[SOURCE])
    row, start_s = np.zeros(1, ROW), time.perf_counter()
    state[8:16] = struct.pack("<q", recorder.writer_pid)
    for number in range(1 << 30):
        fill(row, number)
        recorder.push("control", row)
        state[0:8] = struct.pack("<q", number + 1)
        left_s = start_s + (number + 1) * 1e-3 - time.perf_counter()
        if left_s > 0.0:
            time.sleep(left_s)


def trial(folder: Path, kills_writer: bool, after_s: float) -> float:
    """Run and kill once; returns how much is lost [s]."""
    (folder / "state").write_bytes(bytes(16))
    process = subprocess.Popen([sys.executable, __file__, "--control", str(folder)])
    with (folder / "state").open("r+b") as file:
        state = mmap.mmap(file.fileno(), 16)
    while struct.unpack("<q", state[0:8])[0] == 0:
        time.sleep(0.01)
    time.sleep(after_s)
    (writer,) = struct.unpack("<q", state[8:16])
    os.kill(writer if kills_writer else process.pid, signal.SIGKILL)
    (sent,) = struct.unpack("<q", state[0:8])
    path = folder / "e.mcap"
    if kills_writer:
        process.kill()
        process.wait()
        recover(folder / "e.mcap.partial", folder / "saved.mcap")
        path = folder / "saved.mcap"
    else:
        process.wait()
        while not path.exists():
            time.sleep(0.01)
    episode = read_episode(path)
    count = min(len(stream) for stream in episode.streams.values())
    expected = np.zeros(count, ROW)
    for number in range(count):
        fill(expected[number : number + 1], number)
    for column in SOURCE.columns:
        np.testing.assert_array_equal(episode[column.name].t[:count], expected["t_ns"])
        np.testing.assert_array_equal(episode[column.name].data[:count], expected[column.name])
    return (sent - count) * 1e-3


def main(trials: int) -> None:
    """Run the trials and print a table."""
    rng = random.Random(0)
    lost: dict[str, list[float]] = {"writer": [], "control process": []}
    for number in range(trials):
        killed = "writer" if number % 2 == 0 else "control process"
        with tempfile.TemporaryDirectory() as folder:
            lost[killed].append(trial(Path(folder), killed == "writer", rng.uniform(0.0, 2.0)))
    print(f"{'killed':<16} trials  recovered and equal  lost, median  lost, most  goal")
    for killed, seconds in lost.items():
        print(
            f"{killed:<16} {len(seconds):6}  {len(seconds):19}  {median(seconds) * 1e3:9.0f} ms  "
            f"{max(seconds) * 1e3:7.0f} ms  {GOAL_S * 1e3:.0f} ms"
        )


if __name__ == "__main__":
    if sys.argv[1:2] == ["--control"]:
        control(Path(sys.argv[2]))
    else:
        main(int(sys.argv[1]) if len(sys.argv) > 1 else TRIALS)
