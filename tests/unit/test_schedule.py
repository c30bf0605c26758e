"""The plan that is followed: by stamps, in any number of packets, and nothing of what the gate refuses."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchflow.control import schedule as plans
from wrenchflow.control.packet import MOST_WAYPOINTS, REASONS
from wrenchflow.control.safeguards import HOLD, RUN
from wrenchflow.spatial import make_pose

DOWN = Rotation.from_quat([1.0, 0.0, 0.0, 0.0])
TARGETS = ("x_target", "R_target", "K_lin_target", "K_rot_target", "damping_ratio_target", "wrench_target")


def poses(x_m, turn_rad=None) -> np.ndarray:
    """Poses along x, turned about x from a tool that points down."""
    x_m = np.asarray(x_m, float)
    turn = 0.5 * x_m if turn_rad is None else np.asarray(turn_rad)
    position = np.stack([x_m, 0.0 * x_m, 0.0 * x_m + 0.1], axis=-1)
    turned = Rotation.from_rotvec(turn[:, None] * np.array([1.0, 0.0, 0.0])) * DOWN
    return make_pose(position, turned.as_matrix())


def wandering(n: int, seed: int = 0, step_m: float = 0.01) -> np.ndarray:
    rng = np.random.default_rng(seed)
    position = [0.0, 0.0, 0.1] + rng.normal(size=(n, 3)).cumsum(axis=0) * step_m
    turn = Rotation.from_rotvec(rng.normal(size=(n, 3)).cumsum(axis=0) * 0.05)
    return make_pose(position.clip(-0.45, 0.45), (turn * DOWN).as_matrix())


def x_at(follower, t_ms) -> np.ndarray:
    return np.array([follower.at(t)["x_target"][0] for t in np.atleast_1d(t_ms)])


def bits(follower, t_ms) -> bytes:
    return b"".join(follower.at(t)[name].tobytes() for t in t_ms for name in TARGETS)


# Stamps.


def test_nothing_is_written_until_a_plan_comes(follow):
    follower = follow()
    before = follower.ctl.tobytes()
    follower.at(5)
    assert follower.ctl.tobytes() == before


def test_waypoints_are_met_exactly_at_their_stamps_and_the_last_one_is_held(follow):
    follower, way, t = follow(), wandering(8), 50 * np.arange(1, 9)
    stiff = np.linspace(300.0, 900.0, 8)
    packet = follower.packet(t, way, 0, K_lin=np.eye(3) * stiff[:, None, None], wrench=np.outer(stiff, np.ones(6)))
    assert follower.accept(packet, 2) == "accepted"
    assert follower.ctl[0]["follows_plan"] == 1
    for i, t_ms in enumerate((*t, 10_000)):
        target, i = follower.at(t_ms), min(i, 7)
        np.testing.assert_array_equal(target["x_target"], packet["x"][0, i])
        turned = Rotation.from_quat(way[i, 3:], scalar_first=True).as_matrix()
        np.testing.assert_allclose(target["R_target"], turned, atol=1e-15)
        np.testing.assert_array_equal(target["K_lin_target"], np.eye(3) * stiff[i])
        np.testing.assert_array_equal(target["wrench_target"], stiff[i])
    assert follower.schedule[0]["end_ns"] == follower.ns(400)


def test_a_straight_way_at_constant_speed_and_turn_is_followed_exactly(follow):
    # The stamps are not evenly spaced; the first and the last segment are where it gains speed and loses it.
    follower, t = follow(), np.array([20, 70, 90, 190, 230, 300, 380, 390, 450])
    follower.accept(follower.packet(t, poses(1e-3 * t, 4e-3 * t), 0), 0)
    for t_ms in np.arange(20.0, 390.0, 0.7):
        target = follower.at(t_ms)
        np.testing.assert_allclose(target["x_target"], [1e-3 * t_ms, 0.0, 0.1], atol=1e-12)
        expected = Rotation.from_rotvec([4e-3 * t_ms, 0.0, 0.0]) * DOWN
        np.testing.assert_allclose(target["R_target"], expected.as_matrix(), atol=1e-12)


def test_a_late_plan_is_a_shorter_plan(follow):
    on_time, late = follow(), follow()
    t, way = [50, 100, 150, 200, 250], poses([0.01, 0.02, 0.04, 0.05, 0.05])
    for follower, now_ms in ((on_time, 2), (late, 120)):
        assert follower.accept(follower.packet(t, way, 0), now_ms) == "accepted"
    assert late.schedule[0]["dropped"] == 2
    # The third is met at its own stamp, not 120 ms later; what follows is the same way.
    assert x_at(late, 150) == x_at(on_time, 150)
    np.testing.assert_array_equal(x_at(late, np.arange(200, 400)), x_at(on_time, np.arange(200, 400)))


@pytest.mark.parametrize(("now_ms", "dropped"), [(44.999, 0), (45, 1), (50, 1)])
def test_a_waypoint_that_is_nearer_than_the_lead_is_dropped(follow, now_ms, dropped):
    follower = follow()
    follower.accept(follower.packet([50, 100], poses([0.01, 0.02]), 0), now_ms)
    assert follower.schedule[0]["dropped"] == dropped
    assert follower.schedule[0]["count"] == 3 - dropped


def test_a_plan_whose_waypoints_have_all_passed_is_late_and_changes_nothing(follow):
    follower = follow()
    follower.accept(follower.packet([50, 100, 150], poses([0.01, 0.03, 0.02]), 0), 2)
    before = bits(follower, range(400))
    late = follower.packet([20, 40, 60], poses([0.4, 0.4, 0.4]), 5)
    assert follower.accept(late, 60) == "late"
    assert bits(follower, range(400)) == before
    assert follower.schedule[0]["dropped"] == 3


def test_the_arm_not_the_command_meets_the_stamps_where_its_latency_is_known(follow):
    plain, ahead = follow(), follow(actuation_latency_s=0.03)
    for follower, shift in ((plain, 0), (ahead, 30)):
        t = np.array([50, 100, 150, 200]) + shift
        follower.accept(follower.packet(t, wandering(4), 0), 2)
        later = follower.packet(t + 100, wandering(4, 1), 40)
        assert follower.accept(later, 60) == "accepted"
    assert bits(plain, range(400)) == bits(ahead, range(400))
    assert plain.schedule[0]["end_ns"] == ahead.schedule[0]["end_ns"] == plain.ns(300)
    # A waypoint that the arm could only be late for is dropped.
    assert ahead.accept(ahead.packet([100, 135, 136, 300], wandering(4), 50), 100) == "accepted"
    assert ahead.schedule[0]["dropped"] == 2


def test_from_its_first_kept_stamp_on_a_plan_replaces_the_one_before_and_nothing_earlier(follow):
    follower = follow()
    follower.accept(follower.packet([50, 100, 150, 200, 250, 300], poses([0.01, 0.02, 0.03, 0.04, 0.05, 0.06]), 0), 2)
    follower.accept(follower.packet([210, 260], poses([0.0, -0.01]), 5), 10)
    assert (follower.schedule[0]["t"][:7] - follower.start_ns).tolist() == [
        t * 1_000_000 for t in (2, 50, 100, 150, 200, 210, 260)
    ]
    np.testing.assert_array_equal(x_at(follower, [100, 150, 200, 210, 260]), [0.02, 0.03, 0.04, 0.0, -0.01])


def test_knots_that_have_passed_are_let_go_and_the_way_stays_the_same(follow):
    follower, long = follow(), follow()
    for k in range(0, 4000, 50):
        t = k + 50 * np.arange(1, 9)
        follower.accept(follower.packet(t, poses(0.1 * np.sin(1e-3 * t)), k), k + 2)
        assert follower.schedule[0]["count"] <= 8 + 3
    # One plan of the same stamps, in two packets.
    t = 50 * np.arange(1, 88)
    long.accept(long.packet(t[:50], poses(0.1 * np.sin(1e-3 * t[:50])), 0), 2)
    long.accept(long.packet(t[50:], poses(0.1 * np.sin(1e-3 * t[50:])), 1), 3)
    assert bits(follower, range(4000, 4300)) == bits(long, range(4000, 4300))


# Packets.


@pytest.mark.parametrize("parts", [1, 2, 4, 8])
@pytest.mark.parametrize("blending", [False, True])
def test_a_plan_gives_the_same_bits_in_one_packet_or_in_eight(follow, parts, blending):
    whole, cut = follow(), follow()
    t, way = 130 + 50 * np.arange(16), wandering(16, 1)
    for follower, count in ((whole, 1), (cut, parts)):
        if blending:
            follower.accept(follower.packet([50, 100, 150, 300], wandering(4, 2), 0), 2)
            follower.accept(follower.packet([70, 120, 200, 250], wandering(4, 3), 1), 40)
        for k, some in enumerate(np.array_split(np.arange(16), count)):
            packet = follower.packet(t[some], way[some], 50 + 1e-6 * k)
            assert follower.accept(packet, 80) == "accepted"
    assert bits(cut, range(80, 1000)) == bits(whole, range(80, 1000))
    jumps = [tuple(follower.schedule[0][["seam_jump_m", "seam_jump_rad"]]) for follower in (whole, cut)]
    assert jumps[0] == jumps[1]
    assert (jumps[0][0] > 1e-3) == blending


def test_a_plan_may_come_in_parts_while_it_is_followed(follow):
    whole, cut = follow(), follow()
    t, way = 100 + 50 * np.arange(16), wandering(16, 1)
    assert whole.accept(whole.packet(t, way, 0), 80) == "accepted"
    assert cut.accept(cut.packet(t[:4], way[:4], 0), 80) == "accepted"
    # Each part comes a tick before the target is on the last segment of what is there: it is the one whose end changes.
    since_ms = 80
    for first, now_ms in ((4, 199), (8, 390), (12, 480)):
        assert bits(cut, np.arange(since_ms, now_ms)) == bits(whole, np.arange(since_ms, now_ms))
        since_ms = now_ms
        assert cut.accept(cut.packet(t[first : first + 4], way[first : first + 4], 1 + first), now_ms) == "accepted"
    assert bits(cut, range(480, 1200)) == bits(whole, range(480, 1200))


def test_the_same_plan_once_more_changes_nothing_even_while_an_older_one_decays(follow):
    t, way = 80 + 50 * np.arange(8), wandering(8, 1)
    once, again = follow(), follow()
    for follower in (once, again):
        follower.accept(follower.packet([50, 100, 150, 200, 250], wandering(5, 2), 0), 2)
        follower.accept(follower.packet(t, way, 10), 40)
    assert again.schedule[0]["seam_jump_m"] > 1e-3
    for k, now_ms in enumerate((41, 60.25, 80, 129, 200, 420)):
        assert again.accept(again.packet(t, way, 11 + k), now_ms) == "accepted"
        assert again.schedule[0]["seam_jump_m"] == 0.0
        later = np.arange(now_ms, 600, 0.5)
        assert bits(again, later) == bits(once, later)


def test_of_both_quaternions_of_a_rotation_either_gives_the_same_bits(follow):
    follower, other = follow(), follow()
    t, way = 50 * np.arange(1, 9), wandering(8)
    flipped = way.copy()
    flipped[::2, 3:] *= -1.0
    follower.accept(follower.packet(t, way, 0), 2)
    other.accept(other.packet(t, flipped, 0), 2)
    assert bits(follower, range(500)) == bits(other, range(500))


def test_a_quaternion_of_nearly_unit_length_is_normalised(follow):
    follower, t = follow(), [50, 100]
    scaled = wandering(2)
    scaled[:, 3:] *= [[1.0009], [0.9991]]
    assert follower.accept(follower.packet(t, scaled, 0), 2) == "accepted"
    for t_ms in range(0, 120, 7):
        R = follower.at(t_ms)["R_target"]
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)


# What goes along with the poses.


def test_stiffness_damping_feed_forward_and_gripper_go_straight_from_what_was_asked_before(follow):
    follower = follow()
    given = {
        "K_rot": np.eye(3) * 10.0,
        "damping_ratio": 1.2,
        "wrench": np.full((1, 6), 4.0),
        "gripper": np.array([0.04]),
    }
    follower.accept(follower.packet([100], poses([0.01]), 0, K_lin=np.eye(3) * 900.0, **given), 0)
    half = follower.at(50)
    np.testing.assert_allclose(half["K_lin_target"], np.eye(3) * 700.0)
    np.testing.assert_allclose(half["K_rot_target"], np.eye(3) * 15.0)
    np.testing.assert_allclose(half["wrench_target"], 2.0)
    assert half["damping_ratio_target"] == pytest.approx(1.0)
    assert np.isnan(half["gripper_target"])  # It was not asked for before.
    assert follower.at(100)["gripper_target"] == 0.04


def test_a_width_of_the_gripper_is_asked_for_from_knot_to_knot(follow):
    follower = follow()
    gripper = np.array([0.08, 0.04, np.nan, 0.02])
    follower.accept(follower.packet([100, 200, 300, 400], poses([0.0, 0.0, 0.0, 0.0]), 0, gripper=gripper), 0)
    asked = [follower.at(t)["gripper_target"] for t in (99, 100, 150, 200, 299, 300, 399, 400, 900)]
    np.testing.assert_allclose(asked, [np.nan, 0.08, 0.06, 0.04, 0.04, np.nan, np.nan, 0.02, 0.02])


# Where nothing is followed, the way begins at the last target, at rest.


@pytest.mark.parametrize("why", ["no plan", "plan used up", "a segment is followed", "held"])
def test_where_nothing_is_followed_the_way_begins_at_the_target_at_rest(follow, why):
    follower = follow()
    if why != "no plan":
        follower.accept(follower.packet([50, 100, 300], poses([0.01, 0.02, 0.05]), 0), 2)
        follower.at(150 if why == "held" else 400)
    if why == "a segment is followed":
        follower.ctl[0]["follows_plan"], follower.ctl[0]["x_target"] = 0, [0.07, 0.0, 0.1]
    follower.ctl[0]["mode"] = HOLD if why == "held" else RUN
    before = follower.ctl.copy()
    assert follower.accept(follower.packet([600, 650], poses([0.2, 0.3]), 450), 500) == "accepted"
    follower.ctl[0]["mode"] = RUN
    assert follower.schedule[0]["seam_jump_m"] == 0.0
    for t_ms in (400, 499, 500):
        target = follower.at(t_ms)
        np.testing.assert_array_equal(target["x_target"], before[0]["x_target"])
        np.testing.assert_array_equal(target["R_target"], before[0]["R_target"])
    assert np.abs(follower.at(501)["x_target"] - before[0]["x_target"]).max() < 1e-4
    assert x_at(follower, 600) == 0.2


def test_parts_of_a_plan_that_ends_a_hold_are_one_plan(follow):
    whole, cut = follow(), follow()
    t, way = 100 + 50 * np.arange(8), wandering(8, 1)
    for follower, parts in ((whole, 1), (cut, 4)):
        follower.ctl[0]["mode"] = HOLD  # It becomes RUN at the next tick, after all the parts.
        for k, some in enumerate(np.array_split(np.arange(8), parts)):
            assert follower.accept(follower.packet(t[some], way[some], k), 60) == "accepted"
        follower.ctl[0]["mode"] = RUN
    assert bits(cut, range(60, 600)) == bits(whole, range(60, 600))


def test_a_clock_that_goes_back_begins_anew_from_the_target(follow):
    follower = follow()
    follower.accept(follower.packet([150, 200], poses([0.01, 0.02]), 0), 100)
    follower.at(160)
    here = follower.ctl[0]["x_target"].copy()
    assert follower.accept(follower.packet([80, 130], poses([0.03, 0.04]), 40), 50) == "accepted"
    np.testing.assert_array_equal(follower.at(50)["x_target"], here)
    assert x_at(follower, 80) == 0.03


# The gate.


def spoiled(field, at, value):
    def spoil(packet):
        values = np.array(packet[0][field])
        values[at] = value
        packet[0][field] = values

    return spoil


SKEW = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
UNSOUND = [
    ("empty", spoiled("count", (), 0)),
    ("empty", spoiled("count", (), -(2**63))),
    ("too-many", spoiled("count", (), MOST_WAYPOINTS + 1)),
    ("too-many", spoiled("count", (), 2**63 - 1)),
    ("period", spoiled("period_ns", (), 0)),
    ("period", spoiled("period_ns", (), -1)),
    ("period", spoiled("period_ns", (), 2**62)),  # It would never be missed.
    ("stamps", lambda packet: spoiled("t", 1, packet["t"][0, 0])(packet)),
    ("stamps", lambda packet: spoiled("t", 2, packet["t"][0, 0] + 1)(packet)),
    ("stamps", spoiled("t", 3, -(2**63))),
    ("horizon", lambda packet: spoiled("t", 3, packet["t"][0, 3] + 10_000_000_000)(packet)),
    ("horizon", spoiled("t", 3, 2**63 - 1)),
    ("quaternion", spoiled("quat_wxyz", 1, 0.0)),
    ("quaternion", lambda packet: spoiled("quat_wxyz", 1, packet["quat_wxyz"][0, 1] * 1.0011)(packet)),
    ("quaternion", lambda packet: spoiled("quat_wxyz", 3, packet["quat_wxyz"][0, 3] * 0.9989)(packet)),
    ("workspace", spoiled("x", (2, 1), 0.5001)),
    ("workspace", spoiled("x", (2, 2), -0.5001)),
    ("stiffness", spoiled("K_lin", 1, -np.eye(3))),
    ("stiffness", spoiled("K_rot", 2, 20.0 * np.eye(3) + SKEW)),
    ("stiffness", spoiled("K_lin", (0, 0, 1), 1e6)),
    ("damping-ratio", spoiled("damping_ratio", 3, -1e-9)),
    ("gripper", spoiled("gripper", 1, -1e-9)),
    ("gripper", spoiled("gripper", 2, 1.01)),
    ("replayed", lambda packet: spoiled("t_obs_ns", (), packet["t_obs_ns"][0] - 40_000_000)(packet)),
    ("reordered", lambda packet: spoiled("t_obs_ns", (), packet["t_obs_ns"][0] - 40_000_001)(packet)),
    ("reordered", spoiled("t_obs_ns", (), -(2**63))),
    ("future", lambda packet: spoiled("t_obs_ns", (), packet["t_obs_ns"][0] + 10_000_001)(packet)),
    ("future", spoiled("t_obs_ns", (), 2**63 - 1)),
    ("late", lambda packet: spoiled("t", slice(4), packet["t"][0, :4] - 300_000_000)(packet)),
]
UNSOUND += [
    ("not-finite", spoiled(field, at, value))
    for field, at in [
        ("x", (3, 2)),
        ("quat_wxyz", (0, 3)),
        ("K_lin", (2, 1, 1)),
        ("K_rot", (3, 0, 2)),
        ("damping_ratio", 1),
        ("wrench", (2, 5)),
        ("gripper", 3),
    ]
    for value in (np.nan, np.inf, -np.inf, 1e308, -1e13)
    if not (field == "gripper" and np.isnan(value))
]


@pytest.mark.parametrize(("reason", "spoil"), UNSOUND)
def test_what_is_not_sound_is_named_and_counted_and_changes_nothing(follow, reason, spoil):
    follower = follow()
    follower.accept(follower.packet([100, 150, 250], wandering(3, 1), 0), 2)
    follower.accept(follower.packet([120, 170, 270], wandering(3, 2), 10), 50)  # So that something decays.
    packet = follower.packet([130, 180, 230, 280], wandering(4, 3), 50)
    sound = packet.copy()
    spoil(packet)
    follower.at(60)
    before, ctl = follower.schedule.copy(), follower.ctl.tobytes()
    for times in (1, 2):
        assert follower.accept(packet, 60) == reason
        assert follower.counts() == {"accepted": 2, reason: times}
    assert follower.ctl.tobytes() == ctl
    for counted in ("counts", "dropped"):
        follower.schedule[counted] = before[counted]
    assert follower.schedule.tobytes() == before.tobytes()
    assert follower.accept(sound, 60) == "accepted"


def test_what_lies_beyond_the_count_is_not_looked_at(follow):
    follower, other = follow(), follow()
    packet = follower.packet([50, 100], wandering(2), 0)
    follower.accept(packet, 2)
    for name in ("x", "quat_wxyz", "K_lin", "K_rot", "damping_ratio", "wrench", "gripper"):
        packet[name][0, 2:] = np.nan
    packet["t"][0, 2:] = -1
    assert other.accept(packet, 2) == "accepted"
    assert bits(follower, range(200)) == bits(other, range(200))


@pytest.mark.parametrize(("age_ms", "reason"), [(1000, "accepted"), (1000.001, "past"), (1e6, "past")])
def test_a_plan_from_an_old_observation_is_refused(follow, age_ms, reason):
    follower = follow()
    assert follower.accept(follower.packet([50, 100], wandering(2), -age_ms), 0) == reason


def test_a_plan_that_was_made_before_a_retreat_ended_is_refused(follow):
    follower = follow()
    follower.ctl[0]["retreat_ns"] = follower.ns(20)
    assert follower.accept(follower.packet([100, 150], wandering(2), 19.999), 40) == "retreat"
    assert follower.accept(follower.packet([100, 150], wandering(2), 20), 40) == "accepted"


def test_the_longest_plan_fits_and_parts_that_pile_up_are_refused(follow):
    follower, n = follow(), MOST_WAYPOINTS
    way = np.tile(wandering(1), (n, 1))
    reasons = []
    for k in range(3):
        t = 100 + 10 * (np.arange(n) + k * n)
        reasons.append(follower.accept(follower.packet(t, way, k), 10))
    assert reasons == ["accepted", "too-many", "too-many"]  # Besides its waypoints there is the knot that it began at.
    assert follower.accept(follower.packet(t[: n - 1] - 10 * n, way[: n - 1], 3), 10) == "accepted"


def test_every_reason_has_a_case_here(follow):
    named = {reason for reason, _ in UNSOUND} | {"accepted", "past", "retreat", "stopped"}
    assert named == set(REASONS)


def test_after_clear_nothing_is_followed_and_old_stamps_are_forgotten(follow):
    follower, fresh = follow(), follow()
    packet = follower.packet([50, 100], wandering(2), 0)
    follower.accept(packet, 2)
    follower.accept(packet, 3)
    plans.clear(follower.schedule[0])
    before = follower.ctl.tobytes()
    follower.at(70)
    assert follower.ctl.tobytes() == before
    assert follower.counts() == {}
    follower.ctl[:] = fresh.ctl
    assert [each.accept(packet, 2) for each in (follower, fresh)] == ["accepted"] * 2
    assert bits(follower, range(200)) == bits(fresh, range(200))
