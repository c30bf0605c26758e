"""Where `process` finds the first contact, against where the simulator has it.

    python benchmarks/contact_onset.py --episodes 30

Emulated people do each task; each recording is replayed with its own torques, and the simulator is asked at each tick
what touches the tool, and how hard. The first tick with a contact is the truth.
"""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "harness"))
from force.truth import true_contact
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import demonstrate
from wrenchflow.process.clean import clean_episode
from wrenchflow.process.config import ProcessConfig

TASKS = ("peg-insertion", "surface-wiping", "connector-insertion")
NEAR_NS = 50_000_000


def look(task: str, seed: int, index: int) -> tuple[float | None, int]:
    """How late the first contact of one episode is found [ms], None if it is missed; and how many are found of none."""
    episode = demonstrate(index, CollectConfig(task=task, operator="emulated", seed=seed))
    t, force_n = true_contact(episode)
    touching = force_n > 0.0
    found = clean_episode(episode, ProcessConfig()).episode.events_of("contact")
    false = 0
    for contact in found:
        first, last = np.searchsorted(t, [contact.start_ns - NEAR_NS, contact.stop_ns + NEAR_NS])
        false += not touching[first:last].any()
    if not touching.any() or not found:
        return None, false
    return (found[0].start_ns - int(t[np.argmax(touching)])) * 1e-6, false


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--episodes", type=int, default=30)
    parser.add_argument("--seed", type=int, default=4000)
    parser.add_argument("--jobs", type=int, default=2)
    arguments = parser.parse_args()
    everything: list[float] = []
    with ProcessPoolExecutor(arguments.jobs) as pool:
        for task in TASKS:
            results = list(pool.map(partial(look, task, arguments.seed), range(arguments.episodes)))
            late_ms = np.array([late for late, _ in results if late is not None])
            everything += late_ms.tolist()
            missed, false = len(results) - len(late_ms), sum(false for _, false in results)
            print(f"{task:20} {told(late_ms)}; {missed} of {len(results)} missed, {false} found where nothing touches")
    print(f"{'all':20} {told(np.array(everything))} (goal: median 2 ms)")


def told(late_ms: np.ndarray) -> str:
    """Figures of some errors."""
    off = np.abs(late_ms)
    return (
        f"median error {np.median(off):4.1f} ms, 95 % {np.percentile(off, 95):5.1f} ms, "
        f"median late by {np.median(late_ms):+.1f} ms"
    )


if __name__ == "__main__":
    main()
