"""`analyze` on generated DROID trees, against h5py alone reading the same columns in one process.

Run it as `python benchmarks/analyze_droid.py`; `--memory` instead analyses 200 and 2 000 episodes, each in a process of
its own, and prints the most memory taken.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"

import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "harness"))

from droid.tree import columns_read, write_tree
from wrenchflow.datasets.analysis.analyze import analyze
from wrenchflow.datasets.analysis.config import AnalysisConfig
from wrenchflow.datasets.analysis.open_source import open_source

EPISODES, REPEATS = 2000, 3


def analysed(tree: Path) -> float:
    """Seconds that the analysis takes, page and tables included."""
    out = Path(tempfile.mkdtemp()) / "out"
    start = time.perf_counter()
    *_, found = analyze(open_source(tree), tree, out, AnalysisConfig(task="insert the plug into the socket"))
    seconds = time.perf_counter() - start
    if found is None or found.totals.left_out:
        raise SystemExit("an episode was left out.")
    shutil.rmtree(out.parent)
    return seconds


def read(tree: Path) -> float:
    """Seconds that h5py alone takes for the same columns."""
    start = time.perf_counter()
    for path in sorted(tree.rglob("trajectory.h5")):
        with h5py.File(path, "r") as file:
            for name in columns_read():
                file[name][()]
    return time.perf_counter() - start


def speed() -> None:
    """Print the ratio."""
    with tempfile.TemporaryDirectory() as folder:
        tree = write_tree(Path(folder, "tree"), EPISODES)
        analysed(tree)  # Compiles, and fills the cache of the disk.
        took = np.array([(analysed(tree), read(tree)) for _ in range(REPEATS)])
    ours, alone = np.median(took, axis=0)
    print(f"analyze {ours:.1f} s, h5py alone {alone:.1f} s for {EPISODES} episodes")
    print(f"{np.median(took[:, 0] / took[:, 1]):.2f} times h5py alone (goal 1.7)")


def memory() -> None:
    """Print the most memory that an analysis took, for two numbers of episodes."""
    for count in (200, EPISODES):
        with tempfile.TemporaryDirectory() as folder:
            tree = write_tree(Path(folder, "tree"), count)
            child = subprocess.run(
                [sys.executable, __file__, "--child", tree], check=True, capture_output=True, text=True
            )
        print(f"{count} episodes: {child.stdout.strip()} MiB at most (goal 500)")


if __name__ == "__main__":
    if "--child" in sys.argv:
        analysed(Path(sys.argv[-1]))
        print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
    elif "--memory" in sys.argv:
        memory()
    else:
        speed()
