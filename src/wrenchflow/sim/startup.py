"""The start-up checks on the simulated cell, once a stage: the same that a real cell has to pass."""

import mujoco

from wrenchflow.control.controller import Controller
from wrenchflow.control.startup import StartupReport, check_startup
from wrenchflow.sim.attempt import CHECK, generators
from wrenchflow.sim.config import AttemptConfig
from wrenchflow.sim.plant import Measurement, Plant
from wrenchflow.sim.tasks import scenery


def check_cell(config: AttemptConfig) -> StartupReport:
    """Check a stage's arm, sensor and tool before it begins, at a start of its task that nobody attempts.

    Every random number is of a domain of its own, so no attempt is another for having been checked before.

    Raises:
        ConfigError: If the task or the rig does not exist, or the control configuration is beyond the hardware.
        StartupError: If a check fails.
    """
    task, rig, model = scenery(config.task, config.rig)
    scene_rng, plant_rng, *_ = generators((config.seed, 0, CHECK))
    data = mujoco.MjData(model)
    task.place(model, data, task.draw(model, scene_rng))
    plant = Plant(model, data, rig, Measurement(), plant_rng, capacity_s=0.0)
    return check_startup(plant, Controller(rig, config.control), rig)
