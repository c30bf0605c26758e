"""Writing a LeRobotDataset v3.0: our writer against LeRobot's own, the same rows, in one process.

Both sides get the same features, in memory, and end with a folder that LeRobot loads; ours has exact statistics, which
is checked here, and LeRobot's come from histograms. With and without the (50, 6) force window. Run it as
`python benchmarks/lerobot_export.py`.
"""

import json
import logging
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from statistics import median
from typing import Any

os.environ["HF_HUB_OFFLINE"] = "1"  # Everything is in a temporary folder.

import datasets
import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from wrenchflow.datasets import lerobot
from wrenchflow.datasets import lerobot_layout as layout
from wrenchflow.datasets.about import About
from wrenchflow.observation import OBSERVATIONS, Steps

EPISODES, STEPS, RATE_HZ = 20, 500, 20
REPEATS = 3
MADE_BY_LEROBOT = ("timestamp", "frame_index", "episode_index", "index", "task_index")


def episode(index: int) -> Steps:
    """Random walks with valid quaternions."""
    rng = np.random.default_rng([0, index])
    observations = {}
    for name, shape in OBSERVATIONS.items():
        values = rng.normal(size=(STEPS, *shape)).cumsum(axis=0) * 0.01
        if name.endswith("_pose"):
            values[:, 3:] += [0.0, 5.0, 0.0, 0.0]
            values[:, 3:] /= np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
        observations[name] = values.astype(np.float32)
    return Steps(
        episode_id=f"{index:04d}",
        t=np.arange(STEPS) * (1_000_000_000 // RATE_HZ),
        period_ns=1_000_000_000 // RATE_HZ,
        observations=observations,
        actions=np.tile([0.5, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0], (STEPS, 1)).astype(np.float32),
        task="benchmark",
        skew_ns={name: np.zeros(STEPS, np.int64) for name in ("tcp_pose", "wrench")},
        valid={name: np.ones(STEPS, bool) for name in ("tcp_pose", "wrench")},
    )


def ours(root: Path, episodes: list[Steps]) -> None:
    """Write with our sink."""
    lerobot.write(root, episodes, About())


def theirs(root: Path, episodes: list[Steps], features: dict[str, Any]) -> None:
    """Write with LeRobot's own writer, row by row, as its recorders do."""
    wanted = {name: feature for name, feature in features.items() if name not in MADE_BY_LEROBOT}
    dataset = LeRobotDataset.create("local/theirs", fps=RATE_HZ, features=wanted, root=root, use_videos=False)
    for one in episodes:
        columns = layout.columns(one, 0, 0, 0, RATE_HZ)
        rows = {name: columns[name].reshape(len(one), *feature["shape"]) for name, feature in wanted.items()}
        for k in range(len(one)):
            dataset.add_frame({name: values[k] for name, values in rows.items()} | {"task": one.task})
        dataset.save_episode()
    dataset.finalize()


def rate(write: Any, *arguments: Any) -> tuple[float, Path]:
    """Rows a second, and where they are."""
    root = Path(tempfile.mkdtemp(), "data")
    start = time.perf_counter()
    write(root, *arguments)
    return EPISODES * STEPS / (time.perf_counter() - start), root


def require_equal(root: Path, other: Path, episodes: list[Steps]) -> None:
    """Both folders hold the same items, and our statistics are those of all rows."""
    one, two = (LeRobotDataset("local/x", root=path) for path in (root, other))
    for index in (0, 1, STEPS - 1, STEPS, EPISODES * STEPS - 1):
        a, b = one[index], two[index]
        for name, value in a.items():
            if name != "task" and not np.array_equal(np.asarray(value), np.asarray(b[name])):
                raise SystemExit(f"the two sides hold different values of {name} at row {index}.")
    stats = json.loads((root / "meta" / "stats.json").read_text())
    columns = [layout.columns(each, 0, 0, 0, RATE_HZ) for each in episodes]
    for feature in (layout.STATE, layout.WINDOW):
        if feature in stats:
            rows = np.concatenate([each[feature].reshape(-1, each[feature].shape[-1]) for each in columns])
            np.testing.assert_array_equal(stats[feature]["q99"], np.quantile(rows.astype(np.float64), 0.99, axis=0))
            np.testing.assert_allclose(stats[feature]["std"], rows.astype(np.float64).std(axis=0), rtol=1e-9)


def main() -> None:
    """Measure both sides in turn and print them."""
    logging.disable(logging.WARNING)
    datasets.disable_progress_bars()
    full = [episode(index) for index in range(EPISODES)]
    names = [name for name in OBSERVATIONS if name != "wrench_window"]
    low = [replace(one, observations={name: one.observations[name] for name in names}) for one in full]
    for label, episodes, goal in (("low-dimensional", low, 80), ("with (50, 6) windows", full, 20)):
        rate(ours, episodes)  # Compiles what counts digits.
        mine, other = [], []
        for _ in range(REPEATS):
            fast, root = rate(ours, episodes)
            features = json.loads((root / layout.INFO).read_text())["features"]
            slow, second = rate(theirs, episodes, features)
            mine.append(fast)
            other.append(slow)
        require_equal(root, second, episodes)
        print(
            f"{label}: ours {median(mine):,.0f} rows/s, LeRobot {median(other):,.0f} rows/s, "
            f"{median(mine) / median(other):.1f} times (goal {goal})"
        )


if __name__ == "__main__":
    main()
