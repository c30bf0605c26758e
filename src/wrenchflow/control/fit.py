"""Whether a control configuration is within what the hardware bears: asked once, before anything moves.

A configuration that makes no sense by itself is refused where it is made; what is refused here makes sense for another
robot, sensor or tool.
"""

import math

import numpy as np

from wrenchflow.control.config import ControlConfig
from wrenchflow.control.felt import GRAVITY_M_S2
from wrenchflow.control.stiffness import TICK_S
from wrenchflow.errors import ConfigError
from wrenchflow.rig import ROBOTS, Rig
from wrenchflow.robot_limits import STATED_FOR_CONTROL


def require_within(config: ControlConfig, rig: Rig) -> None:
    """Refuse a configuration beyond the limits of the robot, the sensor or the loop, or whose limits are out of order.

    Args:
        config: Limits and gains.
        rig: The robot cell.

    Raises:
        ConfigError: Says what, got, and allowed.
    """
    robot = rig.robot
    unstated = [name for name in STATED_FOR_CONTROL if getattr(robot, name) is None]
    if unstated:
        raise ConfigError(
            f"robot '{robot.name}' does not state {', '.join(unstated)}, which control needs. "
            f"Robots that state all: {', '.join(ROBOTS)}."
        )
    _require_orders(config)
    _require_speeds(config, rig)
    _require_seen(config, rig)
    _require_reach(rig)
    if not (rate := damping_rate(config, rig) * TICK_S) < 1.0:
        raise ConfigError(
            f"control.damping_ratio_max {config.damping_ratio_max:g} at control.stiffness_max_n_m "
            f"{config.stiffness_max_n_m:g} and control.stiffness_max_nm_rad {config.stiffness_max_nm_rad:g} damps by "
            f"{rate:.3g} of the speed in one tick of {TICK_S:g} s, brakes included, allowed below 1: more would drive "
            "the arm instead of damping it."
        )


def damping_rate(config: ControlConfig, rig: Rig) -> float:
    """An upper bound on how fast the most damped setting takes speed away, in any posture: lambda_max(M^-1 D) [1/s].

    Damping is decided once a tick and holds for it, so T lambda_max(M^-1 D) < 1 must be: at 1 a tick takes away all of
    the speed, and with a command that acts one tick late the loop becomes unstable there. All that damps may act at
    once, and the largest eigenvalue of a sum is no more than the sum of the largest:

        translation, rotation   2 zeta_max sqrt(K_max / m_min) + 1 / brake_s                 each
        joints                  (observer + brake + 2 sqrt(K_null)) / M_min

    m_min is the smallest task inertia. In rotation it is the flange's, I, for a tool only adds to it; in translation,
    with the tool centre point at a distance l from the flange, it is 1 / (1 / sqrt(m_flange) + l / sqrt(I))^2 at least:
    the root of the largest mobility is a norm of J M^-1/2, and that of a sum is no more than the sum of the norms.
    """
    flange, turning, joint = rig.robot.flange_inertia_kg, rig.robot.flange_inertia_kg_m2, rig.robot.joint_inertia_kg_m2
    assert flange is not None
    assert turning is not None
    assert joint is not None
    moving = (1.0 / math.sqrt(flange) + float(np.linalg.norm(rig.T_flange_tcp[:3])) / math.sqrt(turning)) ** -2
    task = sum(
        2.0 * config.damping_ratio_max * math.sqrt(stiffness / inertia) + 1.0 / config.brake_s
        for stiffness, inertia in ((config.stiffness_max_n_m, moving), (config.stiffness_max_nm_rad, turning))
    )
    joints = config.observer_damping_nm_s_rad + config.brake_nm_s_rad + 2.0 * math.sqrt(config.nullspace_nm_rad)
    return task + joints / joint


def _require_orders(config: ControlConfig) -> None:
    """Limits that only make sense one below the other."""
    for low, high in (
        ("stiffness_min_n_m", "stiffness_max_n_m"),
        ("stiffness_min_nm_rad", "stiffness_max_nm_rad"),
        ("damping_ratio_min", "damping_ratio_max"),
        ("zone_speed_m_s", "speed_max_m_s"),
        ("force_max_n", "retreat_force_n"),
        ("moment_max_nm", "retreat_moment_nm"),
        ("retreat_force_n", "impact_force_n"),
        ("tank_start_j", "tank_max_j"),
        ("overrun_s", "overrun_max_s"),
    ):
        _require(f"control.{low}", getattr(config, low), getattr(config, high), f"control.{high}")
    if not config.tank_reserve_j < config.tank_start_j:
        raise ConfigError(
            f"control.tank_reserve_j is {config.tank_reserve_j:g}, allowed less than {config.tank_start_j:g}: "
            "control.tank_start_j."
        )
    # The error of a rotation is that of the shorter way round, so a leash must not let it become half a turn.
    leash_rad = config.moment_max_nm / config.stiffness_min_nm_rad
    _require(
        "control.moment_max_nm over control.stiffness_min_nm_rad", leash_rad, math.pi / 2, "a quarter of a turn, in rad"
    )


def _require_speeds(config: ControlConfig, rig: Rig) -> None:
    """The arm may be faster than its reference by `arm_speed_share` before it is braked."""
    share, name = max(1.0, config.arm_speed_share), f"of robot '{rig.robot.name}'"
    for field, limit in (("speed_max_m_s", "tcp_speed_m_s"), ("turn_max_rad_s", "tcp_turn_rad_s")):
        allowed = getattr(rig.robot, limit) / share
        _require(f"control.{field}", getattr(config, field), allowed, f"{limit} {name} over control.arm_speed_share")
    least = float(np.subtract(rig.robot.position_max_rad, rig.robot.position_min_rad).min())
    _require(
        "control.joint_margin_rad", config.joint_margin_rad, least / 2.0, f"half of the shortest way of a joint {name}"
    )


def _require_seen(config: ControlConfig, rig: Rig) -> None:
    """A trigger beyond what the sensor can read, with the tool on it, can never trigger."""
    weight_n = rig.payload.mass_kg * GRAVITY_M_S2
    force_n = rig.sensor.force_range_n - weight_n
    moment_nm = rig.sensor.torque_range_nm - weight_n * float(np.linalg.norm(rig.payload.com_sensor_m))
    name = f"the range of sensor '{rig.sensor.name}' less the payload's weight"
    _require("control.impact_force_n", config.impact_force_n, force_n, name)
    _require("control.retreat_moment_nm", config.retreat_moment_nm, moment_nm, name)


def _require_reach(rig: Rig) -> None:
    """The corner of the workspace that is furthest from the shoulder must be in reach."""
    shoulder_m, reach_m = rig.robot.shoulder_m, rig.robot.reach_m
    assert shoulder_m is not None
    assert reach_m is not None
    away_m = np.abs(np.subtract([rig.workspace.min_m, rig.workspace.max_m], shoulder_m)).max(axis=0)
    allowed_m = reach_m + float(np.linalg.norm(rig.T_flange_tcp[:3]))
    why = f"reach_m of robot '{rig.robot.name}' and the tool"
    _require("the workspace's furthest corner from the shoulder", float(np.linalg.norm(away_m)), allowed_m, why)


def _require(what: str, got: float, allowed: float, why: str) -> None:
    if not got <= allowed:
        raise ConfigError(f"{what} is {got:.4g}, allowed {allowed:.4g} at most: {why}.")
