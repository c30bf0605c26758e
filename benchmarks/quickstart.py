"""Quickstart on two seeds: time against 10 minutes, success against 92 %, and what the arms without force reach.

uv run python benchmarks/quickstart.py FOLDER
"""

import json
import subprocess
import sys
import time
from pathlib import Path

GOAL_S, GOAL_RATE, GOAL_WITHOUT = 600.0, 0.92, 0.30


def main(folder: Path) -> None:
    """Run each seed as a person would, one process each, and print goal and figure."""
    for seed in (0, 1):
        out = folder / f"seed{seed}"
        start = time.perf_counter()
        command = [sys.executable, "-m", "wrenchflow", "quickstart", str(out), "--seed", str(seed), "--json"]
        done = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True)
        took_s = time.perf_counter() - start
        summary = json.loads(done.stdout)
        print(f"seed {seed}: {took_s:.0f} s, goal {GOAL_S:.0f} s; stages {summary['seconds']}")
        arms = {
            "policy": "",
            "force zeroed": "zeroed_force_",
            "without force": "without_force_",
            "spiral": "blind_spiral_",
        }
        for name, prefix in arms.items():
            low, high = summary[f"{prefix}success_interval"]
            peak = summary[f"{prefix}peak_force_n"]
            goal = {"": f", goal {GOAL_RATE:.0%}", "without_force_": f", expected at most {GOAL_WITHOUT:.0%}"}
            print(
                f"  {name:<14} {summary[f'{prefix}success_rate']:6.1%} [{low:.1%}, {high:.1%}]"
                f"{goal.get(prefix, '')}; peak force {peak['median']:.1f} / {peak['p95']:.1f} N (median / 95 %)"
            )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
