"""What recording costs a paced 1 kHz loop: the call, at p99.9, with the other core loaded, and whether a row is lost.

uv run python benchmarks/recording_call.py [SECONDS] [RUNS]

Each run records all low-dimensional topics of the simulated arm, and two cameras of 224 x 224 at 30 Hz, which are
drawn and compressed in a process of their own. Beside it, an empty call is timed in the same ticks.
"""

import multiprocessing
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import mujoco
import numpy as np

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.sim_camera import SimCamera, views_of
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.recorder import Recorder
from wrenchflow.recording.ring import TAP_ROWS, Ring
from wrenchflow.sim.state import looks_of, looks_size
from wrenchflow.sim.streams import COLUMNS
from wrenchflow.sim.tasks import scenery
from wrenchflow.sim.tasks.task import mjcf_of
from wrenchflow.source import Source

GOAL_US = 50.0
ROW = [("t_ns", "i8"), ("sequence", "i8"), *((column.name, "f8", (column.signal.width,)) for column in COLUMNS)]


def nothing(row: np.ndarray) -> None:
    """The empty call that recording is compared with."""


def burn() -> None:
    """Keep a core busy."""
    while True:
        sum(range(10_000))


@dataclass(frozen=True)
class Run:
    """What came of one run.

    Attributes:
        calls: Time of each recording call [s].
        empty: Time of each empty call [s].
        rows_missing: Rows that are not in the file.
        pictures_missing: Share of the pictures that are not in the file.
    """

    calls: np.ndarray
    empty: np.ndarray
    rows_missing: int
    pictures_missing: float


def run(folder: Path, duration_s: float) -> Run:
    """Record for some time."""
    count = round(duration_s * 1000)
    calls, empty = np.zeros(count), np.zeros(count)
    values = np.random.default_rng(0).normal(size=(64, 80))
    config = CollectConfig(cameras=("wrist", "scene"))
    task, rig, model = scenery(config.task, config.rig)
    views, data, rng = views_of(config, rig), mujoco.MjData(model), np.random.default_rng(0)
    task.place(model, data, task.draw(model, rng))
    row_type = np.dtype([*ROW, ("looks", "f8", (looks_size(model),))], align=True)
    row = np.zeros(1, row_type)
    row["looks"] = looks_of(model, data)
    source = Source(name="control", dtype=row_type, columns=COLUMNS)
    tap = Ring.create(row_type, TAP_ROWS)
    camera = SimCamera(mjcf_of(task, rig), views, tap.name, row_type)
    path, taps = folder / "e.mcap", {source.name: tap.name}
    with Recorder(path, id="e", task="bench", sources=[source], cameras=[camera], taps=taps) as recorder:
        push, start_ns, start_s = recorder.ring("control").push, recorder.clock.now_ns(), time.perf_counter()
        for number in range(count):
            row["t_ns"], row["sequence"] = start_ns + number * 1_000_000, number
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
    tap.close()
    tap.unlink()
    episode = read_episode(path, ["tcp_pose"], messages=[view.frame for view in views])
    pictures = [len(messages) for messages in episode.messages.values()]
    missing = 1.0 - sum(pictures) / (len(pictures) * round(duration_s * 30))
    return Run(calls, empty, count - len(episode["tcp_pose"]), missing)


def main(duration_s: float, runs: int) -> None:
    """Load the other core, run, and print percentiles."""
    load = multiprocessing.get_context("spawn").Process(target=burn, daemon=True)
    load.start()
    p999_us, lost = [], 0
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            of = run(Path(folder), duration_s)
        lost += of.rows_missing
        p999_us.append(float(np.percentile(of.calls, 99.9)) * 1e6)
        print(
            f"recording p50 {np.median(of.calls) * 1e6:5.1f}  p99.9 {p999_us[-1]:6.1f}  "
            f"max {of.calls.max() * 1e6:7.1f} us; empty call p99.9 {np.percentile(of.empty, 99.9) * 1e6:5.1f} us; "
            f"rows lost {of.rows_missing}; pictures not taken {of.pictures_missing:.1%}",
            flush=True,
        )
    load.terminate()
    print(f"median p99.9 {median(p999_us):.1f} us, goal under {GOAL_US:.0f} us; rows lost {lost}, goal 0")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 60.0, int(sys.argv[2]) if len(sys.argv) > 2 else 5)
