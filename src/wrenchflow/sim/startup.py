"""The start-up checks on the simulated cell, once a stage: the same that a real cell has to pass."""

import mujoco

from wrenchflow.control.controller import Controller
from wrenchflow.control.emergency_stop import EmergencyStop
from wrenchflow.control.startup import StartupReport, check_startup
from wrenchflow.sim.attempt import CHECK, generators
from wrenchflow.sim.config import AttemptConfig
from wrenchflow.sim.plant import Measurement, Plant
from wrenchflow.sim.tasks import scenery


def check_cell(config: AttemptConfig, stop: EmergencyStop | None = None) -> StartupReport:
    """Check a stage's arm, sensor and tool before it begins, at a start of its task that nobody attempts.

    Every random number is of a domain of its own, so no attempt is another for having been checked before.

    Args:
        config: Task, rig and limits.
        stop: What brakes the arm from outside; a check that it ends has failed.

    Raises:
        ConfigError: If the task or the rig does not exist, or the control configuration is beyond the hardware.
        StartupError: If a check fails.
    """
    task, rig, model = scenery(config.task, config.rig, config.calibration)
    scene_rng, plant_rng, *_ = generators((config.seed, 0, CHECK))
    data = mujoco.MjData(model)
    task.place(model, data, task.draw(model, scene_rng))
    plant = Plant(model, data, rig, Measurement(), plant_rng, capacity_s=0.0)
    controller = Controller(rig, config.control)
    if stop is not None:
        stop.stops(controller.stop)
    return check_startup(plant, controller, rig)
