"""What a policy sees, checked by hand on poses that a person can picture."""

import numpy as np
import pytest

from wrenchflow.errors import ConfigError, DatasetError
from wrenchflow.policy.features import FORCE_GROUPS, WITH_FORCE, WITHOUT_FORCE, Features, decode_actions, encode_actions

HALF = np.sqrt(0.5)
# The goal stands at x = 0.5 m, turned by 90 degrees about z: its x axis is the base's y axis.
GOAL = np.array([0.5, 0.0, 0.1, HALF, 0.0, 0.0, HALF], np.float32)


def one_step(**changed: list[float]) -> dict[str, np.ndarray]:
    still = {
        "tcp_pose": GOAL,
        "tcp_twist": np.zeros(6),
        "wrench": np.zeros(6),
        "wrench_mean": np.zeros(6),
        "goal_pose": GOAL,
    }
    return {name: np.array(changed.get(name, value), np.float32)[None] for name, value in still.items()}


def test_everything_is_in_the_axes_of_the_goal():
    seen = one_step(
        tcp_pose=[0.5, 0.02, 0.15, HALF, 0.0, 0.0, HALF],
        tcp_twist=[0.0, 0.3, 0.0, 0.0, 0.4, 0.0],
        wrench=[0.0, 5.0, -8.0, 0.0, 0.6, 0.0],
        wrench_mean=[0.0, 4.0, 0.0, 0.0, 0.5, 0.0],
    )
    features = Features(WITH_FORCE)
    got = dict(zip(features.columns, features.encode(seen)[0].tolist(), strict=True))
    expected = dict.fromkeys(features.columns, 0.0) | {
        "position_x_m": 0.02,
        "position_z_m": 0.05,
        "linear_velocity_x_m_s": 0.3,
        "angular_velocity_x_rad_s": 0.4,
        "force_x_n": 5.0,
        "force_z_n": -8.0,
        "torque_x_nm": 0.6,
        "mean_force_x_n": 4.0,
        "mean_torque_x_nm": 0.5,
    }
    assert got == pytest.approx(expected, abs=1e-6)


def test_rotation_is_that_of_the_tool_seen_from_the_goal():
    tilted = [0.5, 0.0, 0.1]
    # Goal times a turn of 0.1 rad about the goal's own x axis.
    tilted += [np.cos(0.05) * HALF, np.sin(0.05) * HALF, np.sin(0.05) * HALF, np.cos(0.05) * HALF]
    got = Features(("rotation",)).encode(one_step(tcp_pose=tilted))
    np.testing.assert_allclose(got[0], [0.1, 0.0, 0.0], atol=1e-6)


def test_without_force_nothing_that_depends_on_the_wrench_or_the_rotation_is_seen():
    features = Features(WITHOUT_FORCE)
    pressed = one_step(wrench=[1.0] * 6, wrench_mean=[1.0] * 6, tcp_twist=[0.0, 0.0, 0.0, 1.0, 1.0, 1.0])
    pressed["tcp_pose"][0, 3:] = [1.0, 0.0, 0.0, 0.0]
    np.testing.assert_array_equal(features.encode(pressed), features.encode(one_step()))
    assert all(features.columns_of(group) == slice(0, 0) for group in FORCE_GROUPS)


def test_columns_of_a_group_are_where_its_names_are():
    features = Features(("position", "wrench", "linear_velocity"))
    assert features.columns[features.columns_of("wrench")][0] == "force_x_n"
    assert len(features.columns) == len(features.floors) == features.width == 12
    assert features.observation_names == ("tcp_pose", "wrench", "tcp_twist", "goal_pose")


def test_actions_far_from_orthonormal_decode_to_unit_quaternions():
    raw = np.array([[0.01, 0.0, 0.0, 2.0, 0.1, 0.0, 0.3, 0.5, 0.0]], np.float32)
    pose = decode_actions(raw, GOAL)
    np.testing.assert_allclose(np.linalg.norm(pose[0, 3:]), 1.0)
    np.testing.assert_allclose(pose[0, :3], [0.5, 0.01, 0.1], atol=1e-6)


def test_a_target_at_the_goal_is_zero_and_identity():
    at_goal = np.array([[0.5, 0.0, 0.1, 0.0, 1.0, 0.0, -1.0, 0.0, 0.0]], np.float32)
    np.testing.assert_allclose(encode_actions(at_goal, GOAL[None])[0], [0, 0, 0, 1, 0, 0, 0, 1, 0], atol=1e-6)


def test_a_missing_observation_is_named_with_what_is_there():
    seen = one_step()
    del seen["wrench_mean"]
    with pytest.raises(DatasetError, match=r"lacks observation 'wrench_mean'.*It has: tcp_pose, tcp_twist, wrench, g"):
        Features(WITH_FORCE).encode(seen)


@pytest.mark.parametrize("groups", [(), ("wrench", "wrench"), ("wrnch",)])
def test_groups_that_make_no_sense_are_refused(groups):
    with pytest.raises(ConfigError):
        Features(groups)
