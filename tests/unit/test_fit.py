"""A configuration beyond what the hardware bears is refused, in one line that says what, got and allowed."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from wrenchflow.control.config import ControlConfig
from wrenchflow.control.damping import design_damping
from wrenchflow.control.fit import damping_rate, require_within
from wrenchflow.errors import ConfigError
from wrenchflow.rig import Rig, load_rig, load_robot
from wrenchflow.robot_limits import STATED_FOR_CONTROL

RIG = load_rig("panda_peg")


@pytest.mark.parametrize("robot", ["panda", "fr3"])
def test_the_defaults_are_within_the_limits_of_every_robot_that_comes_along(robot: str):
    require_within(ControlConfig(), replace(RIG, robot=load_robot(robot)))


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (
            {"speed_max_m_s": 1.5},
            "control.speed_max_m_s is 1.5, allowed 1.417 at most: tcp_speed_m_s of robot 'panda' over "
            "control.arm_speed_share.",
        ),
        ({"turn_max_rad_s": 2.2}, "control.turn_max_rad_s is 2.2, allowed 2.083 at most: tcp_turn_rad_s of robot"),
        ({"turn_max_rad_s": 2.6, "arm_speed_share": 0.5}, "control.turn_max_rad_s is 2.6, allowed 2.5 at most"),
        (
            {"impact_force_n": 196.0},
            "control.impact_force_n is 196, allowed 195.6 at most: the range of sensor 'wrist-6d' less the payload's "
            "weight.",
        ),
        ({"retreat_moment_nm": 9.9}, "control.retreat_moment_nm is 9.9, allowed 9.779 at most: the range of sensor"),
        ({"force_max_n": 41.0}, "control.force_max_n is 41, allowed 40 at most: control.retreat_force_n."),
        ({"moment_max_nm": 6.1}, "control.moment_max_nm is 6.1, allowed 6 at most: control.retreat_moment_nm."),
        ({"retreat_force_n": 81.0}, "control.retreat_force_n is 81, allowed 80 at most: control.impact_force_n."),
        (
            {"zone_speed_m_s": 0.1, "speed_max_m_s": 0.09},
            "control.zone_speed_m_s is 0.1, allowed 0.09 at most: control.speed_max_m_s.",
        ),
        ({"stiffness_min_n_m": 2000.0}, "control.stiffness_min_n_m is 2000, allowed 1500 at most"),
        ({"stiffness_min_nm_rad": 61.0}, "control.stiffness_min_nm_rad is 61, allowed 60 at most"),
        ({"damping_ratio_min": 2.1}, "control.damping_ratio_min is 2.1, allowed 2 at most: control.damping_ratio_max."),
        ({"tank_start_j": 3.1}, "control.tank_start_j is 3.1, allowed 3 at most: control.tank_max_j."),
        (
            {"tank_reserve_j": 2.0},
            "control.tank_reserve_j is 2, allowed less than 2: control.tank_start_j.",
        ),
        ({"overrun_s": 0.006}, "control.overrun_s is 0.006, allowed 0.005 at most: control.overrun_max_s."),
        (
            {"stiffness_min_nm_rad": 1.0},
            "control.moment_max_nm over control.stiffness_min_nm_rad is 3, allowed 1.571 at most: a quarter of a turn, "
            "in rad.",
        ),
        ({"joint_margin_rad": 1.6}, "control.joint_margin_rad is 1.6, allowed 1.501 at most: half of the shortest way"),
        (
            {"damping_ratio_max": 3.0},
            "control.damping_ratio_max 3 at control.stiffness_max_n_m 1500 and control.stiffness_max_nm_rad 60 damps "
            "by 1.05 of the speed in one tick of 0.001 s, brakes included, allowed below 1: more would drive the arm "
            "instead of damping it.",
        ),
        ({"stiffness_max_n_m": 5000.0}, "at control.stiffness_max_n_m 5000 and"),
        ({"stiffness_max_nm_rad": 300.0}, "and control.stiffness_max_nm_rad 300 damps by 1."),
        ({"brake_s": 0.005}, "damps by 1.08 of the speed in one tick"),
        ({"observer_damping_nm_s_rad": 40.0}, "damps by 1.08 of the speed in one tick"),
        ({"brake_nm_s_rad": 30.0}, "damps by 1.08 of the speed in one tick"),
        ({"nullspace_nm_rad": 80.0}, "damps by 1.03 of the speed in one tick"),
    ],
)
def test_a_configuration_beyond_the_hardware_is_refused(config: dict, message: str):
    with pytest.raises(ConfigError) as error:
        require_within(ControlConfig(**config), RIG)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("rig", "message"),
    [
        (
            replace(RIG, workspace=replace(RIG.workspace, max_m=(0.95, 0.35, 0.60))),
            "the workspace's furthest corner from the shoulder is 1.066, allowed 0.995 at most: reach_m of robot "
            "'panda' and the tool.",
        ),
        (replace(RIG, workspace=replace(RIG.workspace, min_m=(0.25, -0.35, -0.5))), "the workspace's furthest corner"),
        (
            replace(RIG, payload=replace(RIG.payload, mass_kg=15.0)),
            "control.impact_force_n is 80, allowed 52.85 at most",
        ),
        (
            replace(RIG, sensor=replace(RIG.sensor, torque_range_nm=5.0)),
            "control.retreat_moment_nm is 6, allowed 4.779",
        ),
        (replace(RIG, T_flange_tcp=(0.0, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0)), "damps by 1.07 of the speed in one tick"),
    ],
)
def test_a_cell_that_the_defaults_are_too_much_for_is_refused(rig: Rig, message: str):
    with pytest.raises(ConfigError) as error:
        require_within(ControlConfig(), rig)
    assert message in str(error.value)


@pytest.mark.parametrize("name", STATED_FOR_CONTROL)
def test_a_robot_that_leaves_a_limit_open_is_refused(name: str):
    """As recordings of before the safety layer do, whose rigs say less: they can be read, not controlled."""
    with pytest.raises(ConfigError, match=rf"^robot 'panda' does not state {name}, which control needs\. Robots that"):
        require_within(ControlConfig(), replace(RIG, robot=replace(RIG.robot, **{name: None})))


def test_the_damping_of_no_posture_is_over_the_bound(peg_model):
    """The bound rests on norms; here is the real thing, with the designed damping and every brake at once."""
    config, data, rng = ControlConfig(), mujoco.MjData(peg_model), np.random.default_rng(0)
    J, M, site = np.zeros((6, 7)), np.zeros((7, 7)), peg_model.site("tcp").id
    K_lin, K_rot = np.eye(3) * config.stiffness_max_n_m, np.eye(3) * config.stiffness_max_nm_rad
    D, P, inertia = np.zeros((6, 6)), np.zeros((6, 7)), np.zeros((6, 6))
    joints = config.observer_damping_nm_s_rad + config.brake_nm_s_rad + 2.0 * math.sqrt(config.nullspace_nm_rad)
    rates = []
    for _ in range(3000):
        data.qpos[:] = rng.uniform(RIG.robot.position_min_rad, RIG.robot.position_max_rad)
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_crb):
            compute(peg_model, data)
        mujoco.mj_jacSite(peg_model, data, J[:3], J[3:], site)
        mujoco.mj_fullM(peg_model, data, M)
        design_damping(J, M, K_lin, K_rot, config.damping_ratio_max, D, P, inertia)
        damping = J.T @ (D + inertia / config.brake_s) @ J + np.eye(7) * joints
        rates.append(np.linalg.eigvals(np.linalg.solve(M, damping)).real.max())
    bound = damping_rate(config, RIG)
    assert max(rates) <= bound
    assert max(rates) > 0.6 * bound  # And it is not so far above that it refuses what would be well.
