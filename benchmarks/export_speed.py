"""Clean recordings to both data sets: 200 episodes of 10 s, without video, on one core, against real time.

The recordings are those of simulated wiping, cut or repeated to 10 s, with all the streams that `process` leaves.
Reading and decompressing them, without anything else, is measured beside it. Run it as `python
benchmarks/export_speed.py`; `--memory` instead exports 200 and 2 000 recordings of 2 s, each in a process of its own,
and prints the most memory taken.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"

import resource
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from wrenchflow.datasets.config import ExportConfig
from wrenchflow.datasets.export import export_folder
from wrenchflow.datasets.sample import STREAMS
from wrenchflow.episode import Episode, Stream
from wrenchflow.recording.reader import find_recordings, read_episode
from wrenchflow.recording.write import write_episode

MODELS, REPEATS = 4, 3
FORMATS = "robomimic,lerobot"


def made(folder: Path, count: int, length_s: float) -> Path:
    """A folder of that many clean recordings of that length."""
    models = [lasting(read_episode(path), length_s) for path in find_recordings(demonstrated())]
    folder.mkdir()
    for i in range(count):
        write_episode(folder / f"{i:05d}.mcap", replace(models[i % len(models)], id=f"{i:05d}"))
    return folder


def demonstrated() -> Path:
    """Some demonstrations, processed."""
    # The process whose memory is measured does without all of these.
    from wrenchflow.collect.config import CollectConfig
    from wrenchflow.collect.folder import collect_folder
    from wrenchflow.process.config import ProcessConfig
    from wrenchflow.process.pipeline import process_folder

    folder = Path(tempfile.mkdtemp())
    config = CollectConfig(task="surface-wiping", rig="panda_wiper", episodes=MODELS, seed=7)
    for _ in collect_folder(folder / "raw", config):
        pass
    for _ in process_folder(folder / "raw", folder / "clean", ProcessConfig()):
        pass
    return folder / "clean"


def lasting(episode: Episode, length_s: float) -> Episode:
    """Its first seconds, repeated where there are too few, and without events, so that all of it is exported."""
    start_ns = max(int(stream.t[0]) for stream in episode.streams.values())
    length_ns = round(length_s * 1e9)

    def of(stream: Stream) -> Stream:
        if len(stream) < 100:  # Said on change.
            return replace(stream, t=stream.t[:1] * 0 + start_ns, data=stream.data[:1])
        period_ns = round(float(np.median(np.diff(stream.t))))
        t = start_ns + np.arange(length_ns // period_ns, dtype=np.int64) * period_ns
        return replace(stream, t=t, data=np.resize(stream.data, (len(t), stream.data.shape[1])))

    streams = {name: of(stream) for name, stream in episode.streams.items()}
    return replace(episode, streams=streams, events=())


def exported(clean: Path) -> float:
    """Seconds that the export takes."""
    out = Path(tempfile.mkdtemp())
    start = time.perf_counter()
    done = list(export_folder(FORMATS, clean, out, ExportConfig()))
    seconds = time.perf_counter() - start
    shutil.rmtree(out)
    if any(one.left_out for one in done):
        raise SystemExit(f"an episode was left out: {done[0].left_out}")
    return seconds


def read(clean: Path) -> float:
    """Seconds that reading the same streams takes."""
    start = time.perf_counter()
    for path in find_recordings(clean):
        read_episode(path, STREAMS)
    return time.perf_counter() - start


def speed() -> None:
    """Print how many times real time the export is."""
    count, length_s = 200, 10.0
    with tempfile.TemporaryDirectory() as folder:
        clean = made(Path(folder, "clean"), count, length_s)
        exported(clean)  # Compiles, and fills the cache of the disk.
        took = [(exported(clean), read(clean)) for _ in range(REPEATS)]
    both, reading = np.median(np.array(took), axis=0)
    print(f"both data sets: {both:.1f} s, {count * length_s / both:.0f} times real time (goal 150)")
    print(f"reading the streams alone: {reading:.1f} s; the export takes {both / reading:.2f} times that")


def memory() -> None:
    """Print the most memory that an export took, for two numbers of episodes."""
    for count in (200, 2000):
        with tempfile.TemporaryDirectory() as folder:
            clean = made(Path(folder, "clean"), count, 2.0)
            child = subprocess.run(
                [sys.executable, __file__, "--child", clean], check=True, capture_output=True, text=True
            )
        print(f"{count} episodes: {child.stdout.strip()} MiB at most (goal 500)")


if __name__ == "__main__":
    if "--child" in sys.argv:
        exported(Path(sys.argv[-1]))
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
    elif "--memory" in sys.argv:
        memory()
    else:
        speed()
