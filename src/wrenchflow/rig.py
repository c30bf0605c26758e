"""The rig: robot limits, sensor and its mount, tool, payload and workspace, as `rig.toml` states them.

Every stage reads the rig. A recording carries the rig that it was made with, so no later stage has to guess it.
"""

import math
from dataclasses import dataclass
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from wrenchflow.config import from_mapping, read_toml, require_at_least, require_finite, require_order, to_mapping
from wrenchflow.errors import ConfigError, unknown
from wrenchflow.robot_limits import RobotLimits, Vector3

Pose = tuple[float, float, float, float, float, float, float]

_PACKAGE = resources.files("wrenchflow")
RIGS = {name: _PACKAGE / f"{name}.toml" for name in ("panda_peg", "panda_plug", "panda_wiper")}
ROBOTS = {name: _PACKAGE / "robots" / f"{name}.toml" for name in ("fr3", "panda")}


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

    def __post_init__(self) -> None:
        _require_pose("sensor.T_flange_sensor", self.T_flange_sensor)
        for name in ("rate_hz", "force_range_n", "torque_range_nm", "lowpass_hz"):
            require_finite(f"sensor.{name}", (getattr(self, name),), positive=True)
        for name in ("noise_force_n", "noise_torque_nm"):
            require_finite(f"sensor.{name}", (getattr(self, name),))
            require_at_least(0, **{f"sensor.{name}": getattr(self, name)})

    @property
    def noise(self) -> Float[np.ndarray, " 6"]:
        """Noise of one sample, force [N] then torque [N.m]. Shape (6,)."""
        return np.repeat([self.noise_force_n, self.noise_torque_nm], 3)

    @property
    def delay_s(self) -> float:
        """How far the sensor's own low-pass, a second-order Butterworth, lags behind a slow force [s]."""
        return math.sqrt(2.0) / (2.0 * math.pi * self.lowpass_hz)

    @property
    def range(self) -> Float[np.ndarray, " 6"]:
        """Largest reading, force [N] then torque [N.m]. Shape (6,)."""
        return np.repeat([self.force_range_n, self.torque_range_nm], 3)


@dataclass(frozen=True, kw_only=True)
class Payload:
    """What hangs below the sensor: mass, and centre of mass in the sensor frame."""

    mass_kg: float
    com_sensor_m: Vector3

    def __post_init__(self) -> None:
        require_finite("payload.com_sensor_m", self.com_sensor_m)
        require_at_least(0, **{"payload.mass_kg": self.mass_kg})
        require_finite("payload.mass_kg", (self.mass_kg,))


@dataclass(frozen=True, kw_only=True)
class Workspace:
    """A box in the base frame that no target may leave."""

    min_m: Vector3
    max_m: Vector3

    def __post_init__(self) -> None:
        require_finite("workspace.min_m", self.min_m)
        require_finite("workspace.max_m", self.max_m)
        require_order("workspace", self.min_m, self.max_m)


@dataclass(frozen=True, kw_only=True)
class CameraMount:
    """Where a camera sits, and how wide it sees; the camera looks along its z, with x to the right and y down."""

    name: str
    parent: Literal["flange", "base"]
    T_parent_camera: Pose
    fov_y_rad: float

    def __post_init__(self) -> None:
        _require_pose(f"cameras.{self.name}.T_parent_camera", self.T_parent_camera)
        if not 0.0 < self.fov_y_rad < math.pi:
            raise ConfigError(f"cameras.{self.name}.fov_y_rad is {self.fov_y_rad:g}, expected between 0 and pi.")


@dataclass(frozen=True, kw_only=True)
class Rig:
    """One robot cell."""

    robot: RobotLimits
    sensor: Sensor
    T_flange_tcp: Pose
    payload: Payload
    workspace: Workspace
    cameras: tuple[CameraMount, ...] = ()

    def __post_init__(self) -> None:
        _require_pose("T_flange_tcp", self.T_flange_tcp)
        names = [camera.name for camera in self.cameras]
        if len(set(names)) != len(names):
            raise ConfigError(f"cameras need names of their own, got {', '.join(names)}.")

    def camera(self, name: str) -> CameraMount:
        """The camera of a name.

        Raises:
            ConfigError: If the rig has none, with the nearest name.
        """
        for camera in self.cameras:
            if camera.name == name:
                return camera
        raise ConfigError(unknown("camera", name, (camera.name for camera in self.cameras)))


def _require_pose(name: str, pose: Pose) -> None:
    require_finite(name, pose)
    norm = math.hypot(*pose[3:])
    if abs(norm - 1.0) > 1e-6:
        raise ConfigError(f"{name} has a quaternion (qw qx qy qz) of length {norm:g}, expected 1.")


def load_rig(name_or_path: str, folder: Path = Path()) -> Rig:
    """Load a rig that comes with wrenchflow by its name, or any other by the path of its TOML file.

    Its `robot` is a whole table, the name of a robot that comes with wrenchflow, or the path of a TOML file, from the
    rig's own folder on. With `extends`, the name or, likewise, the path of another rig, it is that rig but for what it
    says itself: tables are taken over key by key, and lists as a whole.

    Args:
        name_or_path: Which.
        folder: From where on a path goes.

    Raises:
        ConfigError: If there is no such rig or robot, or it makes no sense.
    """
    place = _find("rig", name_or_path, RIGS, folder)
    return from_mapping(Rig, _read_rig(place, ()), where=place.name)


def _read_rig(place: Path | Traversable, extended_by: tuple[Path | Traversable, ...]) -> dict[str, Any]:
    """The values of a rig, with those of the rigs that it extends; a recording then carries all of them."""
    # The same file, whichever of ever longer ways leads to it.
    known = place.resolve() if isinstance(place, Path) else place
    if known in extended_by:
        chain = " extends ".join(f"'{rig.name}'" for rig in (*extended_by, known))
        raise ConfigError(f"rig {chain}, expected a rig that ends this.")
    values, folder = read_toml(place), place.parent if isinstance(place, Path) else Path()
    robot, base = values.get("robot"), values.pop("extends", None)
    if isinstance(robot, str):
        values["robot"] = to_mapping(_load_robot(_find("robot", robot, ROBOTS, folder)))
    if base is None:
        return values
    if not isinstance(base, str):
        raise ConfigError(f"{place.name}.extends: expected the name or the path of a rig, got {base!r}.")
    return _merged(_read_rig(_find("rig", base, RIGS, folder), (*extended_by, known)), values)


def _merged(base: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """`base` with `values` put over it, tables key by key."""
    merged = dict(base)
    for key, value in values.items():
        under = base.get(key)
        merged[key] = _merged(under, value) if isinstance(under, dict) and isinstance(value, dict) else value
    return merged


def load_robot(name_or_path: str) -> RobotLimits:
    """Load the limits of a robot that comes with wrenchflow by its name, or any other by the path of its TOML file."""
    return _load_robot(_find("robot", name_or_path, ROBOTS, Path()))


def _load_robot(place: Path | Traversable) -> RobotLimits:
    return from_mapping(RobotLimits, read_toml(place), where=place.name)


def _find(kind: str, name_or_path: str, built_in: dict[str, Traversable], folder: Path) -> Path | Traversable:
    """Where a rig or a robot is described."""
    if name_or_path in built_in:
        return built_in[name_or_path]
    path = folder / name_or_path
    if path.suffix != ".toml" and path.exists():
        raise ConfigError(f"{kind} '{name_or_path}' is no .toml file. Built in: {', '.join(built_in)}.")
    if path.suffix != ".toml":
        raise ConfigError(f"{unknown(kind, name_or_path, built_in)} A {kind} of your own is named by its .toml file.")
    return path


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
