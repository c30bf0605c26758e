"""Poses are a group, power does not depend on frame or point, and scipy agrees about rotations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wrenchflow.spatial import (
    IDENTITY_POSE,
    compose,
    exp_so3,
    interpolate_pose,
    inverse,
    log_so3,
    make_pose,
    move_twist,
    move_wrench,
    quat_of,
    rot6d_of,
    rotate_screw,
    rotation_of,
    rotation_of_rot6d,
)

seeds = st.integers(0, 2**32 - 1)


def random_poses(rng: np.random.Generator, n: int) -> np.ndarray:
    quat = Rotation.random(n, rng=rng).as_quat(scalar_first=True) * rng.choice([-1.0, 1.0], (n, 1))
    return np.hstack([rng.normal(size=(n, 3)), quat])


def assert_same_pose(actual: np.ndarray, expected: np.ndarray) -> None:
    np.testing.assert_allclose(actual[..., :3], expected[..., :3], atol=1e-12)
    np.testing.assert_allclose(rotation_of(actual[..., 3:]), rotation_of(expected[..., 3:]), atol=1e-12)


@given(seed=seeds)
def test_poses_are_a_group(seed):
    a, b, c = random_poses(np.random.default_rng(seed), 3)
    assert_same_pose(compose(compose(a, b), c), compose(a, compose(b, c)))
    assert_same_pose(compose(a, IDENTITY_POSE), a)
    assert_same_pose(compose(IDENTITY_POSE, a), a)
    assert_same_pose(compose(a, inverse(a)), IDENTITY_POSE)
    assert_same_pose(inverse(compose(a, b)), compose(inverse(b), inverse(a)))


@given(seed=seeds)
def test_many_poses_at_once_give_the_bits_of_one_at_a_time(seed):
    poses = random_poses(np.random.default_rng(seed), 12).reshape(3, 4, 7)
    many = compose(poses, poses[::-1])
    for i in range(3):
        for k in range(4):
            assert many[i, k].tobytes() == compose(poses[i, k], poses[2 - i, k]).tobytes()
    assert compose(poses[0, 0], poses).shape == (3, 4, 7)


@given(seed=seeds, size=st.sampled_from([0.0, 1e-300, 1e-12, 1e-9, 0.99e-8, 1.01e-8, 1e-4, 1.0, 3.1, np.pi - 1e-7]))
def test_exp_and_log_are_inverse_and_agree_with_scipy(seed, size):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    vector = size * axis / np.linalg.norm(axis)
    R = exp_so3(vector)
    np.testing.assert_allclose(R, Rotation.from_rotvec(vector).as_matrix(), atol=1e-15)
    np.testing.assert_allclose(log_so3(R), vector, rtol=1e-8, atol=1e-15)


@given(seed=seeds, past=st.floats(0.0, 1e-3))
def test_the_logarithm_is_never_longer_than_a_half_turn(seed, past):
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    vector = log_so3(exp_so3((np.pi + past) * axis))
    assert np.linalg.norm(vector) <= np.pi * (1.0 + 1e-15)
    np.testing.assert_allclose(exp_so3(vector), exp_so3((np.pi + past) * axis), atol=1e-12)


@pytest.mark.parametrize("axis", np.vstack([np.eye(3), np.eye(3) + np.eye(3)[[1, 2, 0]], [[1.0, 1.0, 1.0]]]))
def test_half_turns_about_exact_axes_keep_their_axis(axis):
    axis = axis / np.linalg.norm(axis)
    R = 2.0 * np.outer(axis, axis) - np.eye(3)
    np.testing.assert_allclose(np.abs(log_so3(R)), np.pi * axis, atol=1e-12)
    np.testing.assert_allclose(rotation_of(quat_of(R)), R, atol=1e-15)


@given(seed=seeds)
def test_quaternions_and_matrices_agree_with_scipy(seed):
    rng = np.random.default_rng(seed)
    turn = Rotation.random(20, rng=rng)
    # Turns of almost half a turn take each of the branches.
    turn = Rotation.concatenate([turn, Rotation.from_rotvec(rng.normal(size=(20, 3)) * 0.01) * turn * turn])
    R = turn.as_matrix()
    quat = quat_of(R)
    assert (quat[:, 0] >= 0.0).all()
    np.testing.assert_allclose(np.linalg.norm(quat, axis=1), 1.0, atol=1e-14)
    expected = turn.as_quat(scalar_first=True, canonical=True)
    np.testing.assert_allclose(np.abs((quat * expected).sum(1)), 1.0, atol=1e-14)
    np.testing.assert_allclose(rotation_of(quat), R, atol=1e-14)
    np.testing.assert_allclose(rotation_of(3.0 * quat), R, atol=1e-14)
    np.testing.assert_allclose(rotation_of(-quat), R, atol=1e-14)


@given(seed=seeds)
def test_six_numbers_are_a_rotation_and_the_nearest_is_found_again(seed):
    rng = np.random.default_rng(seed)
    R = Rotation.random(5, rng=rng).as_matrix()
    np.testing.assert_allclose(rotation_of_rot6d(rot6d_of(R)), R, atol=1e-14)
    loose = rng.normal(size=(5, 6))
    made = rotation_of_rot6d(loose)
    np.testing.assert_allclose(made @ np.swapaxes(made, -1, -2), np.tile(np.eye(3), (5, 1, 1)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(made), 1.0, atol=1e-9)
    # The first column keeps its direction; scale does not matter.
    np.testing.assert_allclose(made[..., 0] * np.linalg.norm(loose[:, :3], axis=1)[:, None], loose[:, :3], atol=1e-12)
    np.testing.assert_allclose(rotation_of_rot6d(7.0 * loose), made, atol=1e-12)


@given(seed=seeds)
def test_power_is_the_same_in_any_frame_and_about_any_point(seed):
    rng = np.random.default_rng(seed)
    wrench, twist = rng.normal(size=(4, 6)), rng.normal(size=(4, 6))
    R, r_m = Rotation.random(4, rng=rng).as_matrix(), rng.normal(size=(4, 3))
    power = (wrench * twist).sum(1)
    turned = (rotate_screw(R, wrench) * rotate_screw(R, twist)).sum(1)
    moved = (move_wrench(wrench, r_m) * move_twist(twist, r_m)).sum(1)
    np.testing.assert_allclose(turned, power, atol=1e-12)
    np.testing.assert_allclose(moved, power, atol=1e-11)


def test_a_wrench_moved_to_a_longer_lever_has_the_moment_of_statics():
    # 10 N along z at the origin, seen from a point 0.2 m along x: the force is 0.2 m behind it, so 2 N.m about y.
    wrench = np.array([0.0, 0.0, 10.0, 0.0, 0.0, 0.0])
    np.testing.assert_allclose(move_wrench(wrench, np.array([0.2, 0.0, 0.0])), [0, 0, 10, 0, 2, 0])
    # A body that turns about z: a point 0.2 m along x moves along y.
    twist = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 3.0])
    np.testing.assert_allclose(move_twist(twist, np.array([0.2, 0.0, 0.0])), [0, 0.6, 0, 0, 0, 3])


@given(seed=seeds)
def test_moving_the_point_there_and_back_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    screw, r_m = rng.normal(size=6), rng.normal(size=3)
    np.testing.assert_allclose(move_wrench(move_wrench(screw, r_m), -r_m), screw, atol=1e-12)
    np.testing.assert_allclose(move_twist(move_twist(screw, r_m), -r_m), screw, atol=1e-12)


@given(seed=seeds, weight=st.floats(0.0, 1.0))
def test_interpolation_ends_exactly_and_goes_the_short_way_at_an_even_rate(seed, weight):
    start, stop = random_poses(np.random.default_rng(seed), 2)
    assert interpolate_pose(start, stop, np.array(0.0)).tobytes() == start.tobytes()
    assert interpolate_pose(start, stop, np.array(1.0)).tobytes() == stop.tobytes()
    middle = interpolate_pose(start, stop, np.array(weight))
    a, m, b = (Rotation.from_quat(pose[3:], scalar_first=True) for pose in (start, middle, stop))
    angle = (a.inv() * b).magnitude()
    np.testing.assert_allclose((a.inv() * m).magnitude(), weight * angle, atol=1e-7)
    np.testing.assert_allclose((m.inv() * b).magnitude(), (1 - weight) * angle, atol=1e-7)
    np.testing.assert_allclose(middle[:3], (1 - weight) * start[:3] + weight * stop[:3], atol=1e-12)


def test_a_pose_is_position_then_quaternion_with_its_real_part_first():
    pose = make_pose(np.array([1.0, 2.0, 3.0]), Rotation.from_euler("z", 90, degrees=True).as_matrix())
    np.testing.assert_allclose(pose, [1, 2, 3, np.sqrt(0.5), 0, 0, np.sqrt(0.5)])
    np.testing.assert_allclose(compose(pose, np.array([1.0, 0, 0, 1, 0, 0, 0]))[:3], [1, 3, 3], atol=1e-15)
