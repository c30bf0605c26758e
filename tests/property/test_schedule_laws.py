"""Whatever plans come: the target is continuous with its velocity, finite, and not far from its waypoints."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wrenchflow.control.packet import MOST_WAYPOINTS, PACKET, REASONS
from wrenchflow.spatial import make_pose

seeds = st.integers(0, 2**32 - 1)
EPS_MS = 1e-3


def wandering(rng: np.random.Generator, n: int, step_m: float = 0.01, turn_rad: float = 0.1) -> np.ndarray:
    position = [0.0, 0.0, 0.1] + rng.normal(size=(n, 3)).cumsum(axis=0) * step_m
    turn = Rotation.from_rotvec(rng.normal(size=(n, 3)).cumsum(axis=0) * turn_rad)
    down = Rotation.from_quat([1.0, 0.0, 0.0, 0.0])
    return make_pose(position.clip(-0.45, 0.45), (turn * down).as_matrix())


def twist(follower, from_ms: float, to_ms: float) -> np.ndarray:
    """Mean twist between two times [m/s, rad/s]."""
    before, after = follower.at(from_ms), follower.at(to_ms)
    turn = Rotation.from_matrix(after["R_target"]) * Rotation.from_matrix(before["R_target"]).inv()
    return np.hstack([after["x_target"] - before["x_target"], turn.as_rotvec()]) / (1e-3 * (to_ms - from_ms))


def bend(follower, t_ms: float, by_ms: float = EPS_MS) -> float:
    """How much the twist changes from the one just before a time to the one just after it [m/s, rad/s]."""
    return np.abs(twist(follower, t_ms, t_ms + by_ms) - twist(follower, t_ms - by_ms, t_ms)).max()


def seam(before, after, now_ms: float) -> float:
    """The same where one follower leaves off and another goes on."""
    return np.abs(twist(after, now_ms, now_ms + EPS_MS) - twist(before, now_ms - EPS_MS, now_ms)).max()


def assert_same_target(one, other, t_ms: float) -> None:
    for name in ("x_target", "R_target"):
        np.testing.assert_allclose(one.at(t_ms)[name], other.at(t_ms)[name], atol=1e-12)


@given(seed=seeds, count=st.integers(1, 10), turn_rad=st.floats(0.0, 0.6))
def test_velocity_is_continuous_across_knots_and_at_both_ends(follow, seed, count, turn_rad):
    rng, follower = np.random.default_rng(seed), follow()
    t = 20 + rng.uniform(20.0, 80.0, size=count).cumsum()
    way = wandering(rng, count, turn_rad=turn_rad)
    assert follower.accept(follower.packet(t, way, 0), 0) == "accepted"
    knots, rotations = np.vstack([[0.0, 0.0, 0.1], way[:, :3]]), Rotation.from_quat(way[:, 3:], scalar_first=True)
    chords = np.linalg.norm(np.diff(knots, axis=0), axis=1)
    chords[1:] += (rotations[1:] * rotations[:-1].inv()).magnitude()
    chords[0] += (rotations[0] * Rotation.from_quat([1.0, 0.0, 0.0, 0.0])).magnitude()
    # A cubic's acceleration is (6 chord + 6 h v) / h^2 at most, and no v is over three chords an h; turning adds to it.
    fastest = (40.0 * chords / (1e-3 * np.diff([0.0, *t])) ** 2).max()
    for t_ms in (0.0, *t):
        assert bend(follower, t_ms) < 1e-3 * EPS_MS * fastest + 1e-6
    assert bend(follower, t[-1]) < 0.1
    np.testing.assert_array_equal(twist(follower, t[-1], t[-1] + 1.0), 0.0)


@given(seed=seeds, receipts_ms=st.lists(st.floats(0.0, 120.0), min_size=1, max_size=6))
def test_position_and_velocity_are_continuous_at_every_receipt(follow, seed, receipts_ms):
    rng, follower = np.random.default_rng(seed), follow()
    follower.accept(follower.packet(50.0 * np.arange(1, 9), wandering(rng, 8, 0.005, 0.05), 0), 2)
    now_ms = 30.0
    for receipt_ms in receipts_ms:
        now_ms += 1.0 + receipt_ms
        t = now_ms - 60.0 + 50.0 * np.arange(1, 9)
        packet = follower.packet(t, wandering(rng, 8, 0.005, 0.05), now_ms - 20.0)
        old, new = follower.clone(), follower.clone(blend_s=0.0)
        assert follower.accept(packet, now_ms) == new.accept(packet, now_ms) == "accepted"
        assert_same_target(follower, old, now_ms)
        # The rate is taken over a tick, so it is off by what the ways accelerate within one.
        bends = [bend(each, now_ms + k, 0.5) for each in (old, new) for k in (0.0, 0.5, 1.0)]
        assert seam(old, follower, now_ms) < 2.0 * max(bends) + 1e-6
        # What decays is gone, and at rest, when it has decayed.
        for t_ms in (now_ms + 100.0, now_ms + 100.0 + EPS_MS):
            assert follower.at(t_ms)["x_target"].tobytes() == new.at(t_ms)["x_target"].tobytes()
        assert seam(follower, new, now_ms + 100.0) < 1e-3


@given(seed=seeds, first=st.integers(1, 6), rest_ms=st.integers(0, 90))
def test_a_plan_that_comes_when_the_last_is_used_up_goes_on_from_what_still_decays(follow, seed, first, rest_ms):
    rng, follower = np.random.default_rng(seed), follow()
    t = 50.0 * np.arange(1, first + 1)
    follower.accept(follower.packet(t, wandering(rng, first, 0.005, 0.05), 0), 2)
    # A plan that ends soon leaves a difference that decays beyond its end.
    end_ms = t[-1] - 4.0
    follower.accept(follower.packet([end_ms], wandering(rng, 1, 0.005, 0.05), 10), end_ms - 6.0)
    now_ms = end_ms + rest_ms
    follower.at(now_ms - 1.0)
    old = follower.clone()
    packet = follower.packet(now_ms + 50.0 * np.arange(1, 5), wandering(rng, 4, 0.005, 0.05), now_ms - 5.0)
    assert follower.accept(packet, now_ms) == "accepted"
    assert_same_target(follower, old, now_ms)
    bends = [bend(old, now_ms + k, 0.5) for k in (0.5, 1.0, 1.5)] + [bend(follower, now_ms + 1.0, 0.5)]
    assert seam(old, follower, now_ms) < 4.0 * max(bends) + 1e-6


@given(seed=seeds, count=st.integers(1, 12))
def test_between_waypoints_the_way_leaves_their_chord_by_three_quarters_of_it_at_most(follow, seed, count):
    rng, follower = np.random.default_rng(seed), follow()
    # Some stamps follow each other within nanoseconds: without a bound on its tangents the way would be light years.
    t = 20.0 + np.where(rng.random(count) < 0.3, 1e-5, rng.uniform(1.0, 400.0, size=count)).cumsum()
    way = make_pose(rng.uniform(-0.5, 0.5, size=(count, 3)), Rotation.random(count, rng=rng).as_matrix())
    assert follower.accept(follower.packet(t, way, 0), 0) == "accepted"
    knots = np.vstack([[0.0, 0.0, 0.1], way[:, :3]])
    for i, (start_ms, stop_ms) in enumerate(zip([0.0, *t[:-1]], t, strict=True)):
        chord = knots[i + 1] - knots[i]
        for t_ms in np.linspace(start_ms, stop_ms, 15):
            x = follower.at(t_ms)["x_target"] - knots[i]
            along = np.clip(x @ chord / (chord @ chord), 0.0, 1.0)
            assert np.linalg.norm(x - along * chord) <= 0.75 * np.linalg.norm(chord) + 1e-9


values = st.one_of(
    st.sampled_from([np.nan, np.inf, -np.inf, 0.0, -0.0, 1.0, -1.0, 0.5, 1e-300, 1e12, -1e12, 1e308, -1e308]),
    st.floats(),
)
integers = st.one_of(
    st.sampled_from([-(2**63), 2**63 - 1, 0, 1, -1, 64, 65]),
    st.integers(-(2**63), 2**63 - 1),
    st.integers(-10, 10).map(lambda k: 50_000_000 * k),
)
spoilers = st.one_of(
    st.tuples(st.sampled_from(["seq", "model", "t_obs_ns", "period_ns", "count"]), st.just(0), integers),
    st.tuples(st.just("t"), st.integers(0, 8), integers),
    st.tuples(
        st.sampled_from(["x", "quat_wxyz", "K_lin", "K_rot", "damping_ratio", "wrench", "gripper"]),
        st.integers(0, 80),
        values,
    ),
)


def assert_sound(follower, t_ms: float) -> None:
    target = follower.at(t_ms)
    for name in ("x_target", "R_target", "K_lin_target", "K_rot_target", "damping_ratio_target", "wrench_target"):
        assert np.isfinite(target[name]).all(), name
    assert not np.isinf(target["gripper_target"])
    R = target["R_target"]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
    # A waypoint lies in the workspace, the way leaves it by 3/4 of a segment, and what decays comes on top.
    outside = np.maximum(np.abs(target["x_target"]) - 0.5, 0.0)
    gap, rate = np.linalg.norm(follower.schedule[0]["blend"][:2], axis=1)
    assert np.linalg.norm(outside) <= 0.75 * np.sqrt(3.0) + gap + 4.0 / 27.0 * rate * 0.1


@given(seed=seeds, spoiled=st.lists(st.lists(spoilers, max_size=3), min_size=1, max_size=6))
def test_a_packet_with_anything_in_it_is_followed_or_refused_and_the_target_stays_sound(follow, seed, spoiled):
    rng, follower, now_ms = np.random.default_rng(seed), follow(), 100.0
    for spoilers in spoiled:
        n = int(rng.integers(1, 9))
        t = now_ms - 20.0 + rng.uniform(1.0, 60.0, size=n).cumsum()
        packet = follower.packet(t, wandering(rng, n, 0.1, 0.5), now_ms - rng.uniform(0.0, 60.0))
        for field, at, value in spoilers:
            flat = packet[field].reshape(-1)
            at %= flat.size
            # A spoiled stamp is one near the others as often as one of another world.
            shift = flat[at] if field in ("t", "t_obs_ns") and abs(value) <= 500_000_000 else 0
            flat[at] = value + shift
        before = follower.counts()
        assert follower.accept(packet, now_ms) in REASONS
        assert sum(follower.counts().values()) == sum(before.values()) + 1
        for step_ms in (0.0, 0.5, 1.0, 3.0, 10.0, 60.0, 2000.0):
            assert_sound(follower, now_ms + step_ms)
        now_ms += float(rng.choice([0.0, 1.0, 30.0, 200.0]))
        follower.at(now_ms)


@given(noise=st.binary(min_size=64, max_size=64), seed=seeds)
def test_noise_is_no_plan(follow, noise, seed):
    follower, bits = follow(), np.random.default_rng(seed).bytes(PACKET.itemsize)
    packet = np.frombuffer(noise + bits[64:], PACKET).copy()
    packet["count"] = 1 + packet["count"] % MOST_WAYPOINTS
    before = follower.ctl.tobytes()
    assert follower.accept(packet, 100.0) != "accepted"
    assert follower.ctl.tobytes() == before
