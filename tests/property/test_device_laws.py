"""A device's counts and the twist that they stand for: one is the other's inverse, and neither leaves its range."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from wrenchflow.collect.devices.emulated_spacemouse import EmulatedSpaceMouse
from wrenchflow.collect.devices.twist_map import TwistMap
from wrenchflow.collect.session import moved
from wrenchflow.spatial import IDENTITY_POSE, exp_so3, make_pose

maps = st.builds(
    TwistMap,
    full_scale_counts=st.sampled_from([350, 500]),
    deadzone=st.sampled_from([0.0, 0.05, 0.2]),
    linear_max_m_s=st.floats(0.01, 1.0),
    angular_max_rad_s=st.floats(0.01, 3.0),
)
counts = st.lists(st.integers(-32768, 32767), min_size=6, max_size=6).map(lambda axes: np.array(axes, np.int64))


def limits(twist_map: TwistMap) -> np.ndarray:
    return np.repeat([twist_map.linear_max_m_s, twist_map.angular_max_rad_s], 3)


@given(twist_map=maps, axes=counts, small=st.booleans())
def test_counts_to_twist_to_counts_is_the_identity_outside_the_deadzone(twist_map, axes, small):
    full = twist_map.full_scale_counts
    axes = axes % (2 * full + 1) - full if small else axes
    inside = np.clip(axes, -full, full)
    resting = np.abs(inside) <= twist_map.deadzone * full
    twist = twist_map.twist(axes)
    np.testing.assert_array_equal(twist_map.counts(twist), np.where(resting, 0, inside))
    np.testing.assert_array_equal(twist[resting], 0.0)
    assert (np.abs(twist) <= limits(twist_map) * (1.0 + 1e-12)).all()
    np.testing.assert_array_equal(np.sign(twist[~resting]), np.sign(axes[~resting]))


@given(twist_map=maps, share=st.lists(st.floats(-1.5, 1.5), min_size=6, max_size=6))
def test_a_twist_is_met_to_half_a_count_and_saturates(twist_map, share):
    twist = np.array(share) * limits(twist_map)
    axes = twist_map.counts(twist)
    assert (np.abs(axes) <= twist_map.full_scale_counts).all()
    a_count = limits(twist_map) / ((1.0 - twist_map.deadzone) * twist_map.full_scale_counts)
    wanted = np.clip(twist, -limits(twist_map), limits(twist_map))
    # One count at the edge of the deadzone may fall into it.
    assert (np.abs(twist_map.twist(axes) - wanted) <= a_count * (1.0 + 1e-9)).all()


def test_a_resting_hand_moves_nothing_and_full_deflection_is_full_speed():
    twist_map = TwistMap()
    np.testing.assert_array_equal(twist_map.twist(np.full(6, 17)), np.zeros(6))
    np.testing.assert_allclose(twist_map.twist(np.full(6, 350)), [0.2, 0.2, 0.2, 0.8, 0.8, 0.8])
    np.testing.assert_allclose(twist_map.twist(np.full(6, -5000)), [-0.2, -0.2, -0.2, -0.8, -0.8, -0.8])


@given(seed=st.integers(0, 2**32 - 1))
def test_the_emulated_hand_brings_the_target_where_it_is_wanted(seed):
    rng, twist_map, period_s = np.random.default_rng(seed), TwistMap(), 0.005
    mouse, target = EmulatedSpaceMouse(twist_map, period_s), IDENTITY_POSE
    wanted = make_pose(rng.uniform(-0.01, 0.01, 3), exp_so3(rng.uniform(-0.02, 0.02, 3)))
    for _ in range(60):
        mouse.deflect(wanted, target)
        axes, _ = mouse.read()
        target = moved(target, twist_map.twist(axes), period_s)
    # To one count's worth of a period.
    np.testing.assert_allclose(target[:3], wanted[:3], atol=0.2 * period_s / 330)
    np.testing.assert_allclose(target[3:], wanted[3:], atol=0.8 * period_s / 330)
