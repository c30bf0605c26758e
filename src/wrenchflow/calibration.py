"""A calibration as a TOML file: what was found to hang below a sensor, how well it is known, and what it is from."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from wrenchflow.config import load, require_finite, to_mapping
from wrenchflow.errors import CalibrationError, ConfigError
from wrenchflow.manifest import sha256_of
from wrenchflow.rig import Payload, Pose, Rig
from wrenchflow.robot_limits import Vector3

Six = tuple[float, float, float, float, float, float]
FOUND = "accepted"
_POSE_TOLERANCE = 1e-6


@dataclass(frozen=True, kw_only=True)
class SourceFile:
    """A recording that a calibration is from.

    Attributes:
        file: Its name.
        sha256: Hash of its bytes.
        rests: How many rests were used of it.
    """

    file: str
    sha256: str
    rests: int


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """What hangs below a sensor; in the sensor frame, force [N] before moment [N.m].

    Attributes:
        verdict: `accepted`: one that is refused is not written.
        date: The day it was made, as in 2025-12-31.
        sensor: Name of the sensor, as the rig has it.
        T_flange_sensor: How it was mounted.
        payload: Mass, and centre of mass in the sensor frame.
        mass_std_kg: Standard deviation of the mass.
        com_std_m: Standard deviations of the centre of mass.
        bias: The sensor's bias amid the last recording; it changes from day to day, and drifts.
        bias_std: Its standard deviations.
        covariance: Of m [kg], m c [kg.m], bias (force, moment); ten rows.
        residual: Root mean square of what payload and bias leave of the rests' mean readings.
        left_n: Most force that they leave of any rest [N].
        left_nm: Most moment [N.m].
        condition: Condition number of the least squares.
        chance: How often noise as it was measured leaves as much or more; near 0, the variances were raised for it.
        rests: How many rests there were in all.
        effective: Share of a rest's samples that are as good as independent, a column.
        limits: What would have been refused.
        sources: The recordings.
    """

    verdict: str
    date: str
    sensor: str
    T_flange_sensor: Pose
    payload: Payload
    mass_std_kg: float
    com_std_m: Vector3
    bias: Six
    bias_std: Six
    covariance: tuple[tuple[float, ...], ...]
    residual: Six
    left_n: float
    left_nm: float
    condition: float
    chance: float
    rests: int
    effective: Six
    limits: dict[str, float]
    sources: tuple[SourceFile, ...]

    def __post_init__(self) -> None:
        if self.verdict != FOUND:
            raise ConfigError(f"a calibration with the verdict '{self.verdict}' cannot be used, expected '{FOUND}'.")
        require_finite("bias", self.bias)
        require_finite("payload.com_sensor_m", self.payload.com_sensor_m)
        require_finite("mass_std_kg", (self.mass_std_kg,))
        if [len(row) for row in self.covariance] != [10] * 10:
            raise ConfigError(f"covariance takes 10 rows of 10, got rows of {[len(row) for row in self.covariance]}.")


def load_calibration(path: Path) -> Calibration:
    """Read one that `calibrate` wrote.

    Raises:
        ConfigError: If it is missing, or no calibration.
    """
    return load(Calibration, path)


def calibration_meta(path: Path | None) -> dict[str, Any]:
    """What an episode says of the calibration that was used: all of it, by its file, or nothing where there is none."""
    if path is None:
        return {}
    return {"calibration": {"file": path.name, "sha256": sha256_of(path), **to_mapping(load_calibration(path))}}


def calibrated(rig: Rig, calibration: Calibration) -> Rig:
    """The rig with the payload that was found.

    Raises:
        CalibrationError: If it is of another sensor, or of one that was mounted otherwise.
    """
    if calibration.sensor != rig.sensor.name:
        raise CalibrationError(
            f"the calibration is of another sensor: got '{calibration.sensor}', expected the rig's '{rig.sensor.name}'."
        )
    if not np.allclose(calibration.T_flange_sensor, rig.sensor.T_flange_sensor, rtol=0.0, atol=_POSE_TOLERANCE):
        raise CalibrationError(
            f"the calibration is of a sensor that was mounted otherwise: got T_flange_sensor "
            f"{list(calibration.T_flange_sensor)}, expected the rig's {list(rig.sensor.T_flange_sensor)}."
        )
    return replace(rig, payload=calibration.payload)


def toml_of(found: Calibration) -> str:
    """The same as the text of a TOML file, with comments for who reads it."""
    mass_g, com_mm = 1e3 * found.payload.mass_kg, [1e3 * x for x in found.payload.com_sensor_m]
    com_std_mm = [1e3 * x for x in found.com_std_m]
    where = ", ".join(f"{x:.2f} +- {2.0 * s:.2f}" for x, s in zip(com_mm, com_std_mm, strict=True))
    lines = [
        "# What hangs below a force/torque sensor, as `wrenchflow calibrate` found it. Use it with",
        "# `process --calibration FILE.toml` and `collect --calibration FILE.toml`, or copy [payload] into a rig.",
        f"# Mass {mass_g:.1f} +- {2e3 * found.mass_std_kg:.1f} g; centre of mass {where} mm (95 %).",
        "",
        f"verdict = {_text(found.verdict)}",
        f"date = {_text(found.date)}",
        f"sensor = {_text(found.sensor)}",
        f"T_flange_sensor = {_list(found.T_flange_sensor)} # x y z [m], qw qx qy qz",
        "",
        "# The sensor's bias amid the last recording, force [N] then moment [N.m]. It is here to be looked",
        "# at: it changes whenever the sensor is switched on, and drifts, so each recording brings its own.",
        f"bias = {_list(found.bias)}",
        f"bias_std = {_list(found.bias_std)}",
        "",
        "# How well all this is known. Standard deviations are of one sigma.",
        f"mass_std_kg = {found.mass_std_kg!r}",
        f"com_std_m = {_list(found.com_std_m)}",
        "# What payload and bias leave of the rests' mean readings: root mean square, and the most of any rest.",
        f"residual = {_list(found.residual)}",
        f"left_n = {found.left_n!r}",
        f"left_nm = {found.left_nm!r}",
        "# How well the ways to hold the tool tell the unknowns apart: 1 is best, 30 is refused.",
        f"condition = {found.condition!r}",
        "# How often noise as it was measured leaves as much; below 0.01 the standard deviations were raised for it.",
        f"chance = {found.chance!r}",
        f"rests = {found.rests}",
        "# Share of the samples of a rest that are as good as independent.",
        f"effective = {_list(found.effective)}",
        "# Rows and columns: mass [kg], mass times centre of mass [kg.m], bias of force [N] and moment [N.m].",
        "covariance = [",
        *(f"    {_list(row)}," for row in found.covariance),
        "]",
        "",
        "[payload] # In the sensor frame.",
        f"mass_kg = {found.payload.mass_kg!r}",
        f"com_sensor_m = {_list(found.payload.com_sensor_m)}",
        "",
        "[limits] # Beyond these it would have been refused.",
        *(f"{name} = {value!r}" for name, value in found.limits.items()),
    ]
    for source in found.sources:
        lines += ["", "[[sources]]", f"file = {_text(source.file)}", f"sha256 = {_text(source.sha256)}"]
        lines.append(f"rests = {source.rests}")
    return "\n".join(lines) + "\n"


def _text(value: str) -> str:
    # A JSON string is a TOML string, where nothing but what has to be is escaped; DEL has to be in TOML alone.
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def _list(values: Sequence[float]) -> str:
    return f"[{', '.join(repr(float(value)) for value in values)}]"
