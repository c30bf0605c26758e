"""Robot descriptions: published figures, loading by name or path, and speed limits that depend on the posture."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from wrenchflow.config import from_mapping, to_mapping
from wrenchflow.control.joint_speed import set_speed_limits, speed_limit
from wrenchflow.control.records import CTL
from wrenchflow.errors import ConfigError
from wrenchflow.rig import RIGS, ROBOTS, load_rig, load_robot, rig_of
from wrenchflow.robot_limits import STATED_FOR_CONTROL, RobotLimits
from wrenchflow.sim.tasks.task import make_model

PANDA, FR3 = load_robot("panda"), load_robot("fr3")


def rig_with(robot: str, folder: Path) -> str:
    """Path of a rig file whose robot is what is given, in TOML."""
    text = RIGS["panda_peg"].read_text()
    assert 'robot = "panda"' in text
    path = folder / "mine.toml"
    path.write_text(text.replace('robot = "panda"', f"robot = {robot}"))
    return str(path)


def test_the_panda_has_the_published_limits():
    assert PANDA.position_min_rad == (-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973)
    assert PANDA.position_max_rad == (2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973)
    assert PANDA.velocity_rad_s == (2.175,) * 4 + (2.61,) * 3
    assert PANDA.acceleration_rad_s2 == (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
    assert PANDA.jerk_rad_s3 == (7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0)
    assert PANDA.torque_nm == (87.0,) * 4 + (12.0,) * 3
    assert PANDA.torque_rate_nm_s == (1000.0,) * 7
    assert (PANDA.tcp_speed_m_s, PANDA.tcp_turn_rad_s, PANDA.slowing) == (1.7, 2.5, None)


def test_the_fr3_has_the_published_limits():
    assert FR3.position_min_rad == (-2.7437, -1.7837, -2.9007, -3.0421, -2.8065, 0.5445, -3.0159)
    assert FR3.position_max_rad == (2.7437, 1.7837, 2.9007, -0.1518, 2.8065, 4.5169, 3.0159)
    assert FR3.velocity_rad_s == (2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26)
    assert FR3.acceleration_rad_s2 == (10.0,) * 7
    assert FR3.jerk_rad_s3 == (5000.0,) * 7
    assert (FR3.torque_nm, FR3.torque_rate_nm_s) == (PANDA.torque_nm, PANDA.torque_rate_nm_s)
    assert (FR3.tcp_speed_m_s, FR3.tcp_turn_rad_s) == (3.0, 2.5)


@pytest.mark.parametrize("robot", [PANDA, FR3], ids=["panda", "fr3"])
def test_robots_that_come_along_state_what_control_needs(robot):
    assert all(getattr(robot, name) is not None for name in STATED_FOR_CONTROL)


def test_the_fr3_slows_down_to_nothing_at_the_ends_of_its_joints_and_nowhere_before_the_joint_is_near():
    """The two tables, of positions and of the curve, were published apart and have to agree."""
    low, high = np.array(FR3.position_min_rad), np.array(FR3.position_max_rad)
    at_low, at_high = FR3.speed_limits(np.stack([low, high]))
    assert (at_low[0] > -0.03).all()  # No way out at the lower end, and the full way in.
    np.testing.assert_array_equal(at_high[0], FR3.velocity_rad_s)
    assert (at_high[1] < 0.03).all()
    np.testing.assert_array_equal(at_low[1], -np.array(FR3.velocity_rad_s))
    middle = np.array([0.0, 0.0, 0.0, -1.6, 0.0, 2.53, 0.0])
    np.testing.assert_array_equal(FR3.speed_limits(middle)[1], FR3.velocity_rad_s)
    # A tenth of a radian before the curve's ends, worked out by hand: -c + sqrt(0.1 a).
    near = np.array([2.6501, 1.6918, 2.8065, -0.2458, 2.7101, 4.4205, 2.9196])
    by_hand = [0.795445, 0.519027, 0.636660, 0.594427, 1.493909, 0.698809, 1.493909]
    np.testing.assert_allclose(FR3.speed_limits(near)[1], by_hand, atol=1e-6)
    near = np.array([-2.6501, -1.6918, -2.8065, -2.9481, -2.7101, 0.64092, -2.9196])
    np.testing.assert_allclose(FR3.speed_limits(near)[0], -np.array(by_hand), atol=1e-6)


def test_the_pandas_speed_limits_are_the_same_everywhere():
    q = np.random.default_rng(0).uniform(-4.0, 4.0, (5, 3, 7))
    low, high = PANDA.speed_limits(q)
    np.testing.assert_array_equal(high, np.broadcast_to(PANDA.velocity_rad_s, q.shape))
    np.testing.assert_array_equal(low, -high)


@pytest.mark.parametrize("robot", [PANDA, FR3], ids=["panda", "fr3"])
def test_the_kernel_gives_the_speed_limits_of_the_description(robot: RobotLimits):
    ctl = np.zeros(1, CTL)
    set_speed_limits(ctl, FR3)  # What was set before must not be left.
    set_speed_limits(ctl, robot)
    q = np.random.default_rng(1).uniform(-4.0, 5.0, (2000, 7))  # Beyond the ends too.
    low, high = robot.speed_limits(q)
    for posture, lowest, highest in zip(q, low, high, strict=True):
        assert [speed_limit(ctl[0], j, posture[j], 1.0) for j in range(7)] == highest.tolist()
        assert [-speed_limit(ctl[0], j, posture[j], -1.0) for j in range(7)] == lowest.tolist()
    assert (low <= 0.0).all()
    assert (high >= 0.0).all()
    if robot is FR3:  # Both branches were seen.
        assert (high == 0.0).any()
        assert ((high > 0.0) & (high < 2.0)).any()


def test_a_speed_limit_at_no_posture_lets_nothing_move():
    ctl = np.zeros(1, CTL)
    set_speed_limits(ctl, FR3)
    assert not speed_limit(ctl[0], 0, np.nan, 1.0) > 0.0


def test_reach_and_inertias_are_those_of_the_arm(rig, peg):
    """Figures that are not published against the model, at the flange with next to nothing on it, in many postures."""
    bare = replace(rig, payload=replace(rig.payload, mass_kg=1e-3))
    model = make_model(peg, bare)
    data, rng, site = mujoco.MjData(model), np.random.default_rng(0), model.site("flange").id
    J, M = np.zeros((6, 7)), np.zeros((7, 7))
    reach_m, inertias = 0.0, []
    for _ in range(10000):
        data.qpos[:] = rng.uniform(PANDA.position_min_rad, PANDA.position_max_rad)
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_crb):
            compute(model, data)
        reach_m = max(reach_m, float(np.linalg.norm(data.site_xpos[site] - np.array(PANDA.shoulder_m))))
        mujoco.mj_jacSite(model, data, J[:3], J[3:], site)
        mujoco.mj_fullM(model, data, M)
        mobility = J @ np.linalg.solve(M, J.T)
        largest = [np.linalg.eigvalsh(block)[-1] for block in (np.linalg.inv(M), mobility[:3, :3], mobility[3:, 3:])]
        inertias.append(1.0 / np.array(largest))
    assert 0.98 * PANDA.reach_m < reach_m < 1.005 * PANDA.reach_m
    least = np.min(inertias, axis=0)
    stated = np.array([PANDA.joint_inertia_kg_m2, PANDA.flange_inertia_kg, PANDA.flange_inertia_kg_m2])
    assert (least >= stated).all()
    assert (least < 1.1 * stated).all()


def test_a_rig_names_its_robot_or_a_file_beside_it_or_holds_the_table(tmp_path: Path):
    assert load_rig("panda_peg").robot == PANDA
    assert load_rig(rig_with('"fr3"', tmp_path)).robot == FR3
    text = ROBOTS["panda"].read_text()
    (tmp_path / "robots").mkdir()
    (tmp_path / "robots" / "slow.toml").write_text(text.replace("tcp_speed_m_s = 1.7", "tcp_speed_m_s = 0.7"))
    assert load_rig(rig_with('"robots/slow.toml"', tmp_path)).robot == replace(PANDA, tcp_speed_m_s=0.7)
    path = Path(rig_with('"panda"', tmp_path))
    path.write_text(path.read_text().replace('robot = "panda"', "", 1) + "\n[robot]\n" + text)
    assert load_rig(str(path)) == load_rig("panda_peg")


def test_a_robot_that_does_not_exist_is_refused_with_the_nearest_one(tmp_path: Path):
    with pytest.raises(
        ConfigError, match=r"^unknown robot 'pandaa'\. Did you mean 'panda'\? Available: fr3, panda\. A"
    ):
        load_rig(rig_with('"pandaa"', tmp_path))
    with pytest.raises(ConfigError, match=r"none\.toml' does not exist"):
        load_rig(rig_with('"none.toml"', tmp_path))
    with pytest.raises(ConfigError, match=r"^mine\.toml\.robot: expected a table of RobotLimits, got 3"):
        load_rig(rig_with("3", tmp_path))
    (tmp_path / "slow.toml").write_text(ROBOTS["panda"].read_text().replace("reach_m", "reech_m"))
    with pytest.raises(ConfigError, match=r"^slow\.toml: unknown key 'reech_m'\. Did you mean 'reach_m'"):
        load_rig(rig_with('"slow.toml"', tmp_path))


@pytest.mark.parametrize("robot", ["panda", "fr3"])
def test_a_recording_carries_all_that_its_robot_states(tmp_path: Path, robot: str):
    rig = load_rig(rig_with(f'"{robot}"', tmp_path))
    assert rig_of({"rig": to_mapping(rig)}, "0001.mcap") == rig


def test_a_recording_of_before_the_safety_layer_still_tells_its_rig():
    """What its robot did not state is not made up: it is not stated."""
    told = to_mapping(load_rig("panda_peg"))
    for name in (*STATED_FOR_CONTROL, "slowing"):
        del told["robot"][name]
    robot = rig_of({"rig": told}, "0001.mcap").robot
    assert robot.torque_nm == PANDA.torque_nm
    assert all(getattr(robot, name) is None for name in STATED_FOR_CONTROL)


@pytest.mark.parametrize(
    ("was", "is_", "message"),
    [
        ("torque_nm = [87.0", "torque_nm = [nan", r"robot\.torque_nm holds nan, expected numbers above 0"),
        ("torque_nm = [87.0", "torque_nm = [-87.0", r"robot\.torque_nm holds -87"),
        (
            "torque_nm = [87.0, ",
            "torque_nm = [",
            r"^robot\.torque_nm has 6 values, expected one for each of 7 joints\.$",
        ),
        ("torque_rate_nm_s = [1000.0", "torque_rate_nm_s = [inf", r"robot\.torque_rate_nm_s holds inf"),
        ("position_min_rad = [-2.7437", "position_min_rad = [2.9", r"robot\.position reaches from 2\.9 to 2\.7437"),
        ("acceleration_rad_s2 = [10.0", "acceleration_rad_s2 = [0.0", r"robot\.acceleration_rad_s2 holds 0"),
        ("jerk_rad_s3 = [5000.0, ", "jerk_rad_s3 = [", r"robot\.jerk_rad_s3 has 6 values"),
        ("tcp_speed_m_s = 3.0", "tcp_speed_m_s = nan", r"robot\.tcp_speed_m_s holds nan"),
        ("tcp_turn_rad_s = 2.5", "tcp_turn_rad_s = -2.5", r"robot\.tcp_turn_rad_s holds -2\.5"),
        ("flange_inertia_kg = 2.4", "flange_inertia_kg = -2.4", r"robot\.flange_inertia_kg holds -2\.4"),
        ("reach_m = 0.855", "reach_m = 0.0", r"robot\.reach_m holds 0"),
        ("shoulder_m = [0.0", "shoulder_m = [inf", r"robot\.shoulder_m holds inf"),
        ("slope_rad_s2 = [12.0", "slope_rad_s2 = [-12.0", r"robot\.slowing\.slope_rad_s2 holds -12"),
        ("offset_rad_s = [0.30, ", "offset_rad_s = [", r"robot\.slowing\.offset_rad_s has 6 values"),
        ("max_rad = [2.7501", "max_rad = [-2.7502", r"robot\.slowing reaches from -2\.7501 to -2\.7502"),
    ],
)
def test_limits_that_are_no_limits_are_refused(tmp_path: Path, was: str, is_: str, message: str):
    text = ROBOTS["fr3"].read_text()
    assert was in text
    (tmp_path / "own.toml").write_text(text.replace(was, is_, 1))
    with pytest.raises(ConfigError, match=message):
        load_robot(str(tmp_path / "own.toml"))


def test_a_robot_from_plain_values_is_the_robot():
    assert from_mapping(RobotLimits, to_mapping(FR3)) == FR3
