"""Who can drive, by name."""

import numpy as np

from wrenchflow.collect.blind_spiral import BlindSpiral
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.devices.device import TeleopDevice
from wrenchflow.collect.devices_table import DEVICES
from wrenchflow.collect.drivers import DeviceDriver, Driver, OperatorDriver
from wrenchflow.collect.hand_driver import HandDriver
from wrenchflow.collect.hand_guided import GuidingDriver, led_by
from wrenchflow.collect.operators import Operator
from wrenchflow.collect.profiles import make_hand, names_of, person_of
from wrenchflow.collect.scripted import Scripted
from wrenchflow.errors import ConfigError, unknown
from wrenchflow.sim.attempt import Attempt
from wrenchflow.sim.tasks import make_task

OPERATORS = ("scripted", "blind-spiral", "emulated", "hand-guided")
_SPIRALLED = "peg-insertion"
_EMULATED = ("emulated", "hand-guided")


def require_operator(config: CollectConfig) -> None:
    """Look names up before any work begins.

    Raises:
        ConfigError: If there is no such operator or person, with the nearest name, or not for this task.
    """
    if config.operator not in (*OPERATORS, *DEVICES):
        raise ConfigError(unknown("operator", config.operator, (*OPERATORS, *DEVICES)))
    if config.operator == "blind-spiral" and config.task != _SPIRALLED:
        raise ConfigError(f"the blind spiral is a baseline of {_SPIRALLED}, and no operator for {config.task}.")
    if config.profiles and config.operator not in _EMULATED:
        raise ConfigError(f"profiles are of {' and '.join(_EMULATED)}, not of '{config.operator}'.")
    if config.device.kind and config.operator != "lerobot":
        raise ConfigError(f"device.kind is of the operator 'lerobot', not of '{config.operator}'.")
    if config.device.recording and config.operator != "replay":
        raise ConfigError(f"device.recording is of the operator 'replay', not of '{config.operator}'.")
    names_of(config)


def make_driver(
    attempt: Attempt, config: CollectConfig, periods: np.ndarray, device: TeleopDevice | None = None
) -> Driver:
    """Who drives an attempt: a person at a device, if there is one, else the operator of `config`.

    Args:
        attempt: Tared.
        config: Names the operator.
        periods: Where the emulated person notes periods, `PERIOD` records.
        device: What a person drives with.

    Raises:
        ConfigError: If there is no such operator, with the nearest name.
        CalibrationError: If the arm did not rest during the tare, or something touched it.
    """
    if device is not None:
        return DeviceDriver(device)
    if config.operator == "emulated":
        _, person = person_of(config, attempt.seed[1])
        return HandDriver(attempt, make_hand(person, config, attempt.rng), periods)
    if config.operator == "hand-guided":
        _, person = person_of(config, attempt.seed[1])
        hand = make_hand(person, config, attempt.rng, led_by(config))
        return GuidingDriver(attempt, hand, config, len(periods))
    return OperatorDriver(
        attempt,
        make_operator(config),
        period_s=1.0 / config.device_hz,
        disturbance_m=config.disturbance_m,
        disturbance_s=config.disturbance_s,
    )


def make_operator(config: CollectConfig) -> Operator:
    """The operator of a configuration that is a piece of Python.

    Raises:
        ConfigError: If there is none, with the nearest name.
    """
    if config.operator == "scripted":
        return Scripted(config.task, make_task(config.task).phases, config.impedance)
    if config.operator == "blind-spiral":
        return BlindSpiral(config.impedance, period_s=1.0 / config.device_hz)
    raise ConfigError(unknown("operator", config.operator, OPERATORS))
