"""Drawing training windows: our tensors and index against LeRobotDataset with the same deltas, on the same data.

Both sides give batches of two observation steps (state and environment state) and eight actions, from one process.
Run it as `python benchmarks/window_sampler.py`.
"""

import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

os.environ["HF_HUB_OFFLINE"] = "1"  # Everything is in a temporary folder.

import numpy as np
import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from torch.utils.data import DataLoader

from wrenchflow.datasets import lerobot
from wrenchflow.datasets.about import About
from wrenchflow.datasets.keys import KEYS, to_keys
from wrenchflow.datasets.lerobot_layout import ACTION, ENVIRONMENT_STATE, STATE, TIME_NS, WINDOW, features_of
from wrenchflow.observation import OBSERVATIONS, Steps
from wrenchflow.train.windows import Windows, make_windows

EPISODES, STEPS, RATE_HZ = 50, 80, 20
N_OBS_STEPS, HORIZON, BATCH = 2, 8, 256
REPEATS = 5
OUR_BATCHES, THEIR_BATCHES = 2000, 2  # A repeat of each side takes about a second.


def episode(index: int) -> Steps:
    """Random walks with valid quaternions."""
    rng = np.random.default_rng([0, index])
    observations = {}
    for name, shape in OBSERVATIONS.items():
        values = rng.normal(size=(STEPS, *shape)).cumsum(axis=0) * 0.01
        if name.endswith("_pose"):
            values[:, 3:] += [5.0, 0.0, 0.0, 0.0]
            values[:, 3:] /= np.linalg.norm(values[:, 3:], axis=1, keepdims=True)
        observations[name] = values.astype(np.float32)
    return Steps(
        episode_id=f"{index:04d}",
        t=np.arange(STEPS) * (1_000_000_000 // RATE_HZ),
        period_ns=1_000_000_000 // RATE_HZ,
        observations=observations,
        actions=np.tile([0.5, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0], (STEPS, 1)).astype(np.float32)
        + rng.normal(size=(STEPS, 1)).astype(np.float32) * 0.01,
    )


def our_windows(episodes: list[Steps]) -> Windows:
    """The columns that LeRobot gives as state and environment state, as one row a step."""
    rows = []
    for one in episodes:
        values = to_keys(one.observations)
        rows.append(
            np.concatenate(
                [values[key.name] for name in (STATE, ENVIRONMENT_STATE) for key in features_of(KEYS)[name]], 1
            )
        )
    return make_windows(rows, [one.actions for one in episodes], n_obs_steps=N_OBS_STEPS, horizon=HORIZON)


def require_equal(windows: Windows, theirs: LeRobotDataset) -> None:
    """Both sides must give the same values, at the edges of episodes too."""
    for index in (0, 1, 7, STEPS - 3, STEPS - 1, STEPS, EPISODES * STEPS - 1):
        observations, actions = windows.take(torch.tensor([index]))
        item: Any = theirs[index]
        seen = torch.cat([item[STATE], item[ENVIRONMENT_STATE]], dim=-1)
        if not (torch.equal(observations[0], seen) and torch.equal(actions[0], item[ACTION])):
            raise SystemExit(f"the two sides gave different windows at step {index}.")


def windows_per_s(draw: Callable[[], object], batches: int) -> float:
    """Windows drawn in a second of wall time."""
    start = time.perf_counter()
    for _ in range(batches):
        draw()
    return batches * BATCH / (time.perf_counter() - start)


def main() -> None:
    """Measure both sides in turn and print them."""
    torch.set_num_threads(1)
    episodes = [episode(index) for index in range(EPISODES)]
    seen, done = ([step / RATE_HZ for step in range(1 - N_OBS_STEPS, stop)] for stop in (1, HORIZON - N_OBS_STEPS + 1))
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder, "lerobot")
        lerobot.write(root, episodes, About())
        theirs = LeRobotDataset(
            "local/windows",
            root=root,
            delta_timestamps={STATE: seen, ENVIRONMENT_STATE: seen, ACTION: done},
            video_backend="pyav",
        )
        # What this side does not draw, the other side need not read either.
        theirs.reader.hf_dataset = theirs.hf_dataset.remove_columns([WINDOW, TIME_NS])
        windows = our_windows(episodes)
        require_equal(windows, theirs)
        generator = torch.Generator().manual_seed(0)
        loader = DataLoader(theirs, BATCH, shuffle=True, drop_last=True, generator=generator)
        ours_hz, theirs_hz = [], []
        for repeat in range(REPEATS + 1):  # The first round warms up.
            batches = iter(loader)
            measured = (
                windows_per_s(lambda: windows.draw(BATCH, generator), OUR_BATCHES),
                windows_per_s(lambda batches=batches: next(batches), THEIR_BATCHES),
            )
            if repeat:
                ours_hz.append(measured[0])
                theirs_hz.append(measured[1])
    print(f"batch {BATCH}, {N_OBS_STEPS} observation steps, {HORIZON} actions, one process, one thread; medians:")
    print(f"  wrenchflow      {median(ours_hz):12,.0f} windows/s")
    print(f"  LeRobotDataset  {median(theirs_hz):12,.0f} windows/s")
    print(f"  ratio           {median(ours_hz) / median(theirs_hz):12,.0f}  (goal 500)")


if __name__ == "__main__":
    main()
