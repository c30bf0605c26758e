"""Plans by their stamps: what is past is dropped, what is left is followed without a jump, and its end is held."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrenchflow.deploy.plans import Plan, PlanFollower
from wrenchflow.errors import ControlError
from wrenchflow.spatial import exp_so3, log_so3, make_pose, rotation_of

MS = 1_000_000
START_NS = 1_577_836_801_000_000_000


def pose(x_m: float, turn_rad: float = 0.0) -> np.ndarray:
    return make_pose(np.array([x_m, 0.0, 0.1]), exp_so3(np.array([np.pi - turn_rad, 0.0, 0.0])))


def plan(t_obs_ms: int, *x_m: float, period_ms: int = 50) -> Plan:
    """Waypoints one period apart, the first one period after the observation."""
    t = START_NS + (t_obs_ms + period_ms * np.arange(1, len(x_m) + 1, dtype=np.int64)) * MS
    return Plan(t_obs_ns=START_NS + t_obs_ms * MS, t=t, poses=np.stack([pose(x, 0.5 * x) for x in x_m]))


def x_at(follower: PlanFollower, t_ms: float) -> float:
    return float(follower.target(START_NS + round(t_ms * MS))[0])


def test_the_target_rests_until_a_plan_comes():
    follower = PlanFollower(pose(0.4), START_NS)
    for t_ms in (-10, 0, 5000):
        np.testing.assert_array_equal(follower.target(START_NS + t_ms * MS), pose(0.4))


def test_waypoints_are_reached_at_their_stamps_and_the_last_one_is_held():
    follower = PlanFollower(pose(0.0), START_NS)
    assert follower.accept(plan(0, 0.1, 0.3, 0.2), START_NS + 2 * MS) == 0
    assert [x_at(follower, t) for t in (50, 100, 150)] == pytest.approx([0.1, 0.3, 0.2])
    assert x_at(follower, 75) == pytest.approx(0.2)
    assert [x_at(follower, t) for t in (151, 10_000)] == pytest.approx([0.2, 0.2])


def test_a_late_plan_is_a_shorter_plan():
    on_time, late = (PlanFollower(pose(0.0), START_NS) for _ in range(2))
    assert on_time.accept(plan(0, 0.1, 0.2, 0.3, 0.4), START_NS + 2 * MS) == 0
    # At 120 ms two waypoints have passed; the third is still met at its own stamp, not 120 ms later.
    assert late.accept(plan(0, 0.1, 0.2, 0.3, 0.4), START_NS + 120 * MS) == 2
    for t in (150, 175, 200, 300):
        assert x_at(late, t) == pytest.approx(x_at(on_time, t))


def test_a_waypoint_that_is_too_near_to_reach_without_a_jump_is_dropped():
    follower = PlanFollower(pose(0.0), START_NS)
    assert follower.accept(plan(0, 0.1, 0.2), START_NS + 46 * MS) == 1
    assert x_at(follower, 100) == pytest.approx(0.2)


def test_a_plan_that_comes_too_late_altogether_changes_nothing():
    follower = PlanFollower(pose(0.0), START_NS)
    follower.accept(plan(0, 0.1, 0.2, 0.3), START_NS)
    before = [x_at(follower, t) for t in range(0, 400, 7)]
    assert follower.accept(plan(-500, 9.0, 9.0, 9.0), START_NS + 60 * MS) == 3
    assert [x_at(follower, t) for t in range(0, 400, 7)] == before


metres = st.floats(-0.2, 0.2, allow_nan=False)


@given(
    first=st.lists(metres, min_size=1, max_size=5),
    second=st.lists(metres, min_size=1, max_size=5),
    observed_ms=st.integers(0, 200),
    latency_ms=st.integers(0, 200),
)
def test_a_new_plan_never_makes_the_target_jump(first, second, observed_ms, latency_ms):
    follower, now_ms = PlanFollower(pose(0.0), START_NS), observed_ms + latency_ms
    now_ns = START_NS + now_ms * MS
    follower.accept(plan(0, *first), START_NS + 2 * MS)
    before = follower.target(now_ns)
    follower.accept(plan(observed_ms, *second), now_ns)
    after = follower.target(now_ns)
    np.testing.assert_allclose(after[:3], before[:3], atol=1e-12)
    assert np.linalg.norm(log_so3(rotation_of(after[3:]) @ rotation_of(before[3:]).T)) < 1e-7
    # The steepest way there is: half a metre within the 5 ms that a waypoint is away at least.
    t = np.arange(0, 600)
    x = np.array([x_at(follower, now_ms + float(ms)) for ms in t])
    assert np.abs(np.diff(x)).max() <= 0.4 / 5.0 + 1e-9


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_pose_that_is_not_finite_never_becomes_a_plan(bad):
    poses = np.stack([pose(0.1), pose(0.2)])
    poses[1, 2] = bad
    t = START_NS + np.array([50, 100]) * MS
    with pytest.raises(ControlError, match=f"made at {START_NS} ns has a pose that is not finite"):
        Plan(t_obs_ns=START_NS, t=t, poses=poses)


@pytest.mark.parametrize("stamps", [[], [100, 50], [50, 50]])
def test_stamps_must_increase(stamps):
    t = np.array(stamps, np.int64)
    poses = np.tile(pose(0.1), (len(t), 1)) if len(t) else np.empty((0, 7))
    with pytest.raises(ControlError, match="needs increasing stamps, got"):
        Plan(t_obs_ns=START_NS, t=t, poses=poses)
