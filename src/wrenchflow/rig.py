"""The rig: robot limits, sensor and its mount, tool, payload and workspace, as `rig.toml` states them.

Every stage reads the rig. A recording carries the rig that it was made with, so no later stage has to guess it.
"""

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from wrenchflow.config import from_mapping, load
from wrenchflow.errors import ConfigError, unknown

Vector3 = tuple[float, float, float]
Pose = tuple[float, float, float, float, float, float, float]
JointValues = tuple[float, ...]

BUILT_IN = ("panda_peg",)


@dataclass(frozen=True, kw_only=True)
class RobotLimits:
    """Limits of an arm, one value a joint."""

    name: str
    position_min_rad: JointValues
    position_max_rad: JointValues
    velocity_rad_s: JointValues
    torque_nm: JointValues
    torque_rate_nm_s: JointValues

    def __post_init__(self) -> None:
        n = len(self.position_min_rad)
        for name in ("position_max_rad", "velocity_rad_s", "torque_nm", "torque_rate_nm_s"):
            if len(getattr(self, name)) != n:
                raise ConfigError(f"robot.{name} has {len(getattr(self, name))} values; position_min_rad has {n}.")


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """A force/torque sensor: where it sits, and how it reads.

    `noise_*` is the standard deviation of one sample, after the sensor's own low-pass.
    """

    name: str
    T_flange_sensor: Pose
    rate_hz: float
    force_range_n: float
    torque_range_nm: float
    noise_force_n: float
    noise_torque_nm: float
    lowpass_hz: float

    @property
    def noise(self) -> Float[np.ndarray, " 6"]:
        """Noise of one sample, force [N] then torque [N.m]. Shape (6,)."""
        return np.repeat([self.noise_force_n, self.noise_torque_nm], 3)

    @property
    def range(self) -> Float[np.ndarray, " 6"]:
        """Largest reading, force [N] then torque [N.m]. Shape (6,)."""
        return np.repeat([self.force_range_n, self.torque_range_nm], 3)


@dataclass(frozen=True, kw_only=True)
class Payload:
    """What hangs below the sensor: mass, and centre of mass in the sensor frame."""

    mass_kg: float
    com_sensor_m: Vector3


@dataclass(frozen=True, kw_only=True)
class Workspace:
    """A box in the base frame that no target may leave."""

    min_m: Vector3
    max_m: Vector3


@dataclass(frozen=True, kw_only=True)
class Rig:
    """One robot cell."""

    robot: RobotLimits
    sensor: Sensor
    T_flange_tcp: Pose
    payload: Payload
    workspace: Workspace


def load_rig(name_or_path: str) -> Rig:
    """Load a rig that comes with wrenchflow by its name, or any other by the path of its TOML file."""
    if name_or_path in BUILT_IN:
        with resources.as_file(resources.files("wrenchflow") / f"{name_or_path}.toml") as path:
            return load(Rig, path)
    path = Path(name_or_path)
    if path.suffix != ".toml" and path.exists():
        raise ConfigError(f"rig '{name_or_path}' is no .toml file. Built in: {', '.join(BUILT_IN)}.")
    if path.suffix != ".toml":
        raise ConfigError(f"{unknown('rig', name_or_path, BUILT_IN)} A rig of your own is named by its .toml file.")
    return load(Rig, path)


def rig_of(meta: dict[str, Any] | Any, where: str) -> Rig:
    """The rig that a recording carries in its metadata.

    Args:
        meta: `Episode.meta`.
        where: Name of the recording, for the message.

    Raises:
        ConfigError: If there is none, or it is not a rig.
    """
    if "rig" not in meta:
        raise ConfigError(f"{where} carries no rig, so its sensor mount and payload are unknown.")
    return from_mapping(Rig, meta["rig"], where=f"{where}: rig")
