"""Known pushes on the tool of the simulated arm, after a calibration: what the processed wrench says of them.

Run it as `python benchmarks/known_pushes.py [RUNS [PUSHES]]`. Each run calibrates a tool that is not the rig's, then
begins anew with another bias, tares, and is pushed with 1 to 10 N in any direction, at two ways to hold the tool. It is
pushed twice, as long as a demonstration takes. The sensor drifts meanwhile: of ten pushes the last are further off.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from wrenchflow.collect.calibrate import calibrate, simulated_truth
from wrenchflow.control.controller import TICK_S
from wrenchflow.episode import Episode
from wrenchflow.errors import CalibrationError
from wrenchflow.process.calibrate_config import CalibrateConfig
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.pipeline import process_episode
from wrenchflow.rig import Payload, Rig, load_rig
from wrenchflow.sim.attempt import CALIBRATE, Attempt
from wrenchflow.sim.config import AttemptConfig
from wrenchflow.sim.free_space import free_space
from wrenchflow.sim.tasks.task import make_model
from wrenchflow.spatial import exp_so3, make_pose, rotation_of

RUNS, PUSHES = 100, 2
SHARE, LEAST_N = 0.02, 0.05
SETTLE_TICKS, MEAN_TICKS, TURN_TICKS = 2500, 1000, 2000
TILT_RAD = 0.4


def pushed(rig: Rig, truth: Payload, pushes_n: np.ndarray, seed: int) -> tuple[Episode, list[tuple[int, int]]]:
    """A recording of an arm whose tool is pushed, and when [ns] each push was steady.

    Args:
        rig: As believed.
        truth: What hangs below the sensor.
        pushes_n: What the environment does to the tool, base axes. Shape (k, 3).
        seed: Of the sensor.
    """
    scene = free_space(rig, truth)
    model = make_model(scene, rig)
    ticks = TURN_TICKS + len(pushes_n) * (SETTLE_TICKS + MEAN_TICKS)
    attempt = Attempt(scene, model, rig, AttemptConfig(), seed=(seed, 1, CALIBRATE), time_limit_s=ticks * TICK_S + 1.0)
    tool, home = model.body("tool").id, attempt.controller.target_pose
    tilted = make_pose(home[:3], exp_so3(np.array([0.0, TILT_RAD, 0.0])) @ rotation_of(home[3:]))
    spans, here = [], home
    for number, push_n in enumerate(pushes_n):
        there = home if number < len(pushes_n) // 2 else tilted
        if there is not here:
            attempt.controller.ask(here, there, ticks=TURN_TICKS, impedance=attempt.impedance)
            attempt.plant.data.xfrc_applied[tool] = 0.0
            attempt.follow(TURN_TICKS)
            here = there
        elif number == 0:
            attempt.controller.ask(here, here, ticks=1, impedance=attempt.impedance)
        attempt.plant.data.xfrc_applied[tool, :3] = push_n
        attempt.follow(SETTLE_TICKS)
        rows = attempt.follow(MEAN_TICKS)
        spans.append((int(rows["t_ns"][0]), int(rows["t_ns"][-1])))
    return attempt.episode(f"pushed-{seed}", {}, []), spans


def run(seed: int, pushes: int, folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How hard each push was [N], and how far off the mean is, calibrated and not [N]. Each of shape (pushes,)."""
    config, rig = CalibrateConfig(seed=seed), load_rig("panda_peg")
    out = folder / f"{seed}.toml"
    calibrate(out, [], config, date="2025-01-01")
    rng = np.random.default_rng((seed, 7))
    directions = rng.normal(size=(pushes, 3))
    sizes_n = rng.uniform(1.0, 10.0, pushes)
    pushes_n = sizes_n[:, None] * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    episode, spans = pushed(rig, simulated_truth(config), pushes_n, seed)
    off_n = []
    for calibration in (out, None):
        try:
            clean, _ = process_episode(episode, ProcessConfig(calibration=calibration))
        except CalibrationError:
            if calibration is not None:
                raise
            off_n.append(np.full(pushes, np.nan))  # So wrong a payload is refused at the tare.
            continue
        # The robot exerts on the environment the opposite of what the environment does to the tool.
        means = np.array([clean["wrench"].between(*span).data[:, :3].mean(axis=0) for span in spans])
        off_n.append(np.linalg.norm(means + pushes_n, axis=1))
    return sizes_n, off_n[0], off_n[1]


def main() -> None:
    """Print the goal and what was measured."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else RUNS
    pushes = int(sys.argv[2]) if len(sys.argv) > 2 else PUSHES
    with tempfile.TemporaryDirectory() as folder:
        results = [run(seed, pushes, Path(folder)) for seed in range(runs)]
    sizes_n, off_n, uncalibrated_n = (np.concatenate(part) for part in zip(*results, strict=True))
    print(f"{len(sizes_n)} pushes of 1 to 10 N in {runs} runs, mean of 1 s, length of the error's vector")
    print(f"goal               {SHARE:.0%} of the push or {LEAST_N:g} N, whichever is more")
    for name, errors_n in (("calibrated", off_n), ("the rig's payload", uncalibrated_n)):
        refused = np.isnan(errors_n).mean()
        share = (errors_n <= np.maximum(SHARE * sizes_n, LEAST_N)).mean()
        print(
            f"{name:<18} {share:6.1%} within it; median {np.nanmedian(errors_n):.3f} N, "
            f"95 % {np.nanquantile(errors_n, 0.95):.3f} N, largest {np.nanmax(errors_n):.3f} N; "
            f"refused {refused:.0%}"
        )


if __name__ == "__main__":
    main()
