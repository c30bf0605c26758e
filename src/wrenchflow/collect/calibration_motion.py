"""The calibration motion on the simulated arm: the tool is held in several ways, and at each the arm rests."""

from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from wrenchflow.collect.calibration_poses import plan_poses, turn_between
from wrenchflow.config import to_mapping
from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.control.controller import TICK_S
from wrenchflow.control.records import JOINTS
from wrenchflow.episode import Episode, Event
from wrenchflow.errors import CalibrationError
from wrenchflow.process.calibrate_config import MotionConfig
from wrenchflow.process.rests import REST
from wrenchflow.rig import Payload, Rig
from wrenchflow.sim.attempt import CALIBRATE, Attempt, episode_id
from wrenchflow.sim.config import AttemptConfig
from wrenchflow.sim.free_space import TASK, free_space, pose_of
from wrenchflow.sim.plant import Measurement
from wrenchflow.sim.reach import can_go
from wrenchflow.sim.tasks.task import make_model

_LISTEN_S, _STILL_RAD_S = 0.25, 0.002
# Stiffer in its posture and better damped than a demonstration: joints that creep for seconds are at no rest.
_IMPEDANCE = Impedance(damping_ratio=1.2)
_CONTROL = ControlConfig(nullspace_nm_rad=20.0)


def _ticks(seconds: float) -> int:
    return round(seconds / TICK_S)


def run_motion(
    rig: Rig,
    truth: Payload,
    *,
    seed: int = 0,
    index: int = 0,
    config: MotionConfig | None = None,
    measurement: Measurement | None = None,
) -> Episode:
    """Run the motion in virtual time, under the control core and its safety layer, and record it as an attempt is.

    Args:
        rig: The robot cell as it is believed to be.
        truth: What really hangs below the sensor.
        seed: With the index it determines every bit of the recording: bias, drift and noise of the sensor.
        index: Number of the run.
        config: How many poses, how slow, for how long.
        measurement: How well the arm knows itself; without it, as a real one.

    Returns:
        The streams of any attempt; the rests are phases `rest 1` to `rest k`, after the `tare`. The true payload and
        bias stand in `meta["simulator"]`, where no stage looks.

    Raises:
        CalibrationError: If the arm cannot reach the poses, or the safety layer ended the motion.
    """
    config = config or MotionConfig()
    scene = free_space(rig, truth)
    model = make_model(scene, rig)
    poses = plan_poses(rig, np.array(scene.home), config.poses, partial(can_go, model, rig.robot))
    scene = replace(scene, poses=tuple(pose_of(pose) for pose in poses), rest_s=config.rest_s)
    attempts = AttemptConfig(task=TASK, seed=seed, impedance=_IMPEDANCE, control=_CONTROL)
    turns_s = sum(turn_between(*pair) for pair in pairwise(poses)) / config.turn_rad_s
    attempt = Attempt(
        scene,
        model,
        rig,
        attempts,
        seed=(seed, index, CALIBRATE),
        measurement=measurement,
        time_limit_s=turns_s + len(poses) * (config.settle_max_s + config.rest_s) + 1.0,
    )
    rests = _go(attempt, poses, config)
    episode = attempt.episode(
        episode_id(TASK, seed, index), {}, rests, motion={**to_mapping(config), "T_base_tcp": poses.tolist()}
    )
    truths = {"payload": to_mapping(truth), "sensor": _sensor_of(attempt)}
    return episode.with_meta(simulator={**episode.meta["simulator"], **truths})


def _go(attempt: Attempt, poses: Float[np.ndarray, "k 7"], config: MotionConfig) -> list[Event]:
    """Go from pose to pose and rest at each; returns the rests."""
    controller, rests = attempt.controller, []
    here = controller.target_pose
    for number, pose in enumerate(poses, start=1):
        ticks = max(1, _ticks(turn_between(here, pose) / config.turn_rad_s))
        controller.ask(here, pose, ticks=ticks, impedance=attempt.impedance)
        here = pose
        attempt.follow(ticks)
        _settle(attempt, config.settle_max_s, f"pose {number} of {len(poses)}")
        rows = attempt.follow(_ticks(config.rest_s))
        rests.append(Event(int(rows["t_ns"][0]), int(rows["t_ns"][-1]), "phase", f"{REST} {number}"))
    return rests


def _settle(attempt: Attempt, most_s: float, where: str) -> None:
    """Wait until no joint turns any more.

    Raises:
        CalibrationError: If that takes too long, or the safety layer stopped the arm.
    """
    controller, was_still = attempt.controller, False
    for _ in range(round(most_s / _LISTEN_S)):
        rows = attempt.follow(_ticks(_LISTEN_S))
        if controller.mode != "run":
            raise CalibrationError(
                f"the safety layer ended the calibration motion at {where}: got mode '{controller.mode}' by "
                f"'{controller.cause}', expected 'run'."
            )
        # The mean over a window, for single samples scatter; of two windows, for one may hold a turning point.
        fastest = float(np.abs(rows["joint_states"][:, JOINTS : 2 * JOINTS].mean(axis=0)).max())
        is_still = fastest <= _STILL_RAD_S
        if is_still and was_still:
            return
        was_still = is_still
    raise CalibrationError(
        f"the arm does not come to rest at {where}: got {fastest:.2g} rad/s after {most_s:g} s, expected "
        f"{_STILL_RAD_S:g} rad/s at most."
    )


def _sensor_of(attempt: Attempt) -> dict[str, list[float]]:
    """The sensor's bias at the end, and how much it changes in a minute, which only a simulation knows."""
    state = attempt.plant.sensor
    return {"bias_end": state["bias"].tolist(), "drift_per_min": (state["drift"] * 60.0 / TICK_S).tolist()}
