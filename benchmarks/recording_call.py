"""What recording costs a paced 1 kHz loop: the call, at p99.9, with the other core loaded, and whether a row is lost.

uv run python benchmarks/recording_call.py [SECONDS] [RUNS]

Each run records all low-dimensional topics of the simulated arm; beside it, an empty call is timed in the same ticks.
"""

import multiprocessing
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

import numpy as np

from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.recorder import Recorder
from wrenchflow.signals import IMPEDANCE, JOINT_TORQUE, JOINTS, POSE, TWIST, WRENCH
from wrenchflow.source import Column, Source

GOAL_US = 50.0
COLUMNS = (
    Column(name="joint_states", signal=JOINTS),
    Column(name="joint_command", signal=JOINT_TORQUE),
    Column(name="external_torque", signal=JOINT_TORQUE),
    Column(name="tcp_pose", signal=POSE, frame="base"),
    Column(name="tcp_twist", signal=TWIST, frame="base"),
    Column(name="wrench_raw", signal=WRENCH, frame="sensor"),
    Column(name="target_pose", signal=POSE, frame="base"),
    Column(name="command_pose", signal=POSE, frame="base"),
    Column(name="impedance", signal=IMPEDANCE, frame="base"),
)
ROW = np.dtype([("t_ns", "i8"), *((column.name, "f8", (column.signal.width,)) for column in COLUMNS)], align=True)


def nothing(row: np.ndarray) -> None:
    """The empty call that recording is compared with."""


def burn() -> None:
    """Keep a core busy."""
    while True:
        sum(range(10_000))


def run(folder: Path, duration_s: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Time of each recording call and of each empty one [s], and rows that are missing in the file."""
    count = round(duration_s * 1000)
    calls, empty = np.zeros(count), np.zeros(count)
    row, values = np.zeros(1, ROW), np.random.default_rng(0).normal(size=(64, 80))
    source = Source(name="control", dtype=ROW, columns=COLUMNS)
    with Recorder(folder / "e.mcap", id="e", task="bench", sources=[source]) as recorder:
        push, start_ns, start_s = recorder.ring("control").push, time.time_ns(), time.perf_counter()
        for number in range(count):
            row["t_ns"] = start_ns + number * 1_000_000
            for column in COLUMNS:
                row[column.name] = values[number % 64, : column.signal.width]
            a = time.perf_counter()
            nothing(row)
            b = time.perf_counter()
            push(row)
            recorder.is_alive  # noqa: B018 (what a control loop asks at each tick)
            c = time.perf_counter()
            empty[number], calls[number] = b - a, c - b
            left_s = start_s + (number + 1) * 1e-3 - c
            if left_s > 2e-4:
                time.sleep(left_s - 1.5e-4)
            while time.perf_counter() < start_s + (number + 1) * 1e-3:
                pass
    return calls, empty, count - len(read_episode(folder / "e.mcap", ["tcp_pose"])["tcp_pose"])


def main(duration_s: float, runs: int) -> None:
    """Load the other core, run, and print percentiles."""
    load = multiprocessing.get_context("spawn").Process(target=burn, daemon=True)
    load.start()
    p999_us, lost = [], 0
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            calls, empty, missing = run(Path(folder), duration_s)
        lost += missing
        p999_us.append(float(np.percentile(calls, 99.9)) * 1e6)
        print(
            f"recording p50 {np.median(calls) * 1e6:5.1f}  p99.9 {p999_us[-1]:6.1f}  max {calls.max() * 1e6:7.1f} us; "
            f"empty call p99.9 {np.percentile(empty, 99.9) * 1e6:5.1f} us; rows lost {missing}"
        )
    load.terminate()
    print(f"median p99.9 {median(p999_us):.1f} us, goal under {GOAL_US:.0f} us; rows lost {lost}, goal 0")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0, int(sys.argv[2]) if len(sys.argv) > 2 else 5)
