"""What a device may do to the target: move it as the map says, no faster, and not at all when anything is wrong."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from safety.arena import Arena
from safety.checks import check
from wrenchflow.collect.devices.device import Reading
from wrenchflow.collect.devices.emulated_spacemouse import EmulatedSpaceMouse, count_of, steer_to
from wrenchflow.collect.devices.hid_report import encode_motion, encode_split
from wrenchflow.collect.devices.twist_map import AXES, TwistMap
from wrenchflow.collect.follow import PROBLEMS, Follower, follow, past_deadzone
from wrenchflow.control.config import Impedance
from wrenchflow.control.records import CTL, REQ
from wrenchflow.spatial import IDENTITY_POSE, exp_so3, make_pose, rotation_of

PERIOD_TICKS, PERIOD_NS, PERIOD_S = 5, 5_000_000, 0.005
START_NS = 1_577_836_800_000_000_000
SILENT, LEAPED, UNSOUND = PROBLEMS[1:]
# A float is rounded once or twice on the way to a limit.
ROUNDING = 1.0 + 1e-12


class Desk:
    """A follower without an arm: what is asked for stands in a request that nobody reads."""

    def __init__(self, settings=None, full_scale_counts=350, target=IDENTITY_POSE):
        self.map = TwistMap(**(settings or {}))
        self.follower = Follower(self.map, Impedance(), target, full_scale_counts=full_scale_counts, ticks=PERIOD_TICKS)
        self.req, self.ctl, self.now_ns = np.zeros(1, REQ), np.zeros(1, CTL), START_NS

    def hear(self, counts=(0,) * 6, *, age_ns=0, **said):
        reading = Reading(t_ns=self.now_ns - age_ns, counts=np.array(counts, np.int64), **said)
        self.follower.take(reading)

    def period(self, step_ns=PERIOD_NS):
        """Go on by a period; returns the twist and why there is none."""
        follow(self.follower.record[0], self.now_ns, self.req[0], self.ctl[0])
        self.now_ns += step_ns
        return self.follower.twist.copy(), self.follower.problem

    @property
    def limits(self):
        return np.repeat([self.map.linear_max_m_s, self.map.angular_max_rad_s], 3)


@st.composite
def axis_maps(draw):
    order = draw(st.permutations(range(6)))
    signs = draw(st.lists(st.booleans(), min_size=6, max_size=6))
    return tuple(("-" if minus else "") + AXES[axis] for axis, minus in zip(order, signs, strict=True))


# What a map is made of. The map itself is made in the test: its checked types roll dice, which no strategy may.
maps = st.fixed_dictionaries(
    {
        "deadzone": st.sampled_from([0.0, 0.05, 0.2]),
        "linear_max_m_s": st.floats(0.01, 1.0),
        "angular_max_rad_s": st.floats(0.01, 3.0),
        "axes": axis_maps(),
    }
)
full_scales = st.sampled_from([350, 500])
# Six of what 16 bits hold, and of what no device ever says.
counts = st.lists(
    st.one_of(st.integers(-600, 600), st.integers(-32768, 32767), st.integers(-(2**60), 2**60)),
    min_size=6,
    max_size=6,
)
deflected = counts.filter(lambda axes: any(axes))
# Position and rotation vector.
places = st.tuples(
    st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3), st.lists(st.floats(-1.8, 1.8), min_size=3, max_size=3)
)


def pose_of(place):
    return make_pose(np.array(place[0]), exp_so3(np.array(place[1])))


@given(settings=maps, full_scale=full_scales, axes=counts)
def test_no_counts_ask_for_more_than_full_speed(settings, full_scale, axes):
    desk = Desk(settings, full_scale)
    desk.hear(axes)
    twist, problem = desk.period()
    assert problem == ""
    assert (np.abs(twist) <= desk.limits * ROUNDING).all()


@given(settings=maps, full_scale=full_scales, axes=counts)
def test_the_deadzone_moves_nothing_and_what_is_past_it_keeps_its_sense(settings, full_scale, axes):
    desk = Desk(settings, full_scale)
    desk.hear(axes)
    twist, _ = desk.period()
    said = np.array(desk.map.axis_signs) * np.array(axes, float)[desk.map.axis_numbers]
    resting = np.abs(said) <= desk.map.deadzone * full_scale
    np.testing.assert_array_equal(twist[resting], 0.0)
    np.testing.assert_array_equal(np.sign(twist[~resting]), np.sign(said[~resting]))


@given(settings=maps, full_scale=full_scales, axes=counts)
def test_counts_to_speed_to_counts_is_the_identity_past_the_deadzone(settings, full_scale, axes):
    desk = Desk(settings, full_scale)
    state = desk.follower.record[0]
    for count in axes:
        inside = min(max(count, -full_scale), full_scale)
        resting = abs(inside) <= desk.map.deadzone * full_scale
        assert count_of(state, past_deadzone(state, inside)) == (0 if resting else inside)


@given(settings=maps)
def test_the_axes_are_moved_by_a_signed_permutation(settings):
    moves = np.zeros((6, 6))
    for axis in range(6):
        desk = Desk(settings)
        desk.hear([350 if a == axis else 0 for a in range(6)])
        moves[:, axis] = desk.period()[0] / desk.limits
    assert set(np.unique(moves.round(12))) <= {-1.0, 0.0, 1.0}
    np.testing.assert_allclose(moves @ moves.T, np.eye(6), atol=1e-12)
    for row, said in zip(moves, desk.map.axes, strict=True):
        assert row[AXES.index(said.removeprefix("-"))] == pytest.approx(-1.0 if said.startswith("-") else 1.0)


@given(settings=maps, heard=st.lists(counts, min_size=1, max_size=20), start=places)
def test_the_target_is_the_integral_of_the_twist(settings, heard, start):
    start = pose_of(start)
    desk = Desk(settings, target=start)
    x, R, stop = start[:3], rotation_of(start[3:]), start[:3]
    for axes in heard:
        desk.hear(axes)
        twist, _ = desk.period()
        req = desk.req[0]
        # What is asked for begins where the last period ended, to the bit.
        np.testing.assert_array_equal(req["x_start"], stop)
        np.testing.assert_allclose(req["R_start"], R, atol=1e-12)
        x, R = x + twist[:3] * PERIOD_S, Rotation.from_rotvec(twist[3:] * PERIOD_S).as_matrix() @ R
        np.testing.assert_array_equal(req["x_stop"], x)
        np.testing.assert_allclose(req["turn"], twist[3:] * PERIOD_S, rtol=1e-15)
        stop = req["x_stop"].copy()
        at = desk.follower.target_pose
        np.testing.assert_array_equal(at[:3], x)
        np.testing.assert_allclose(rotation_of(at[3:]), R, atol=1e-12)
    assert (desk.req[0]["ticks"], desk.ctl[0]["is_asked"]) == (PERIOD_TICKS, 1)


def stands_still(desk, reason):
    before = desk.follower.target_pose
    twist, problem = desk.period()
    np.testing.assert_array_equal(twist, 0.0)
    assert problem == reason
    np.testing.assert_array_equal(desk.follower.target_pose, before)
    np.testing.assert_array_equal(desk.req[0]["x_start"], desk.req[0]["x_stop"])
    np.testing.assert_array_equal(desk.req[0]["turn"], 0.0)
    # The arm is told to stay, which is not the same as being told nothing.
    assert desk.ctl[0]["is_asked"] == 1


@given(axes=deflected, dead_man_s=st.sampled_from([0.02, 0.1, 0.5]), age=st.floats(0.0, 3.0))
def test_a_deflected_device_that_is_silent_moves_nothing(axes, dead_man_s, age):
    desk, dead_man_ns = Desk({"dead_man_s": dead_man_s, "deadzone": 0.0}), round(dead_man_s * 1e9)
    age_ns = round(age * dead_man_ns)
    desk.hear(axes, age_ns=age_ns)
    if age_ns > dead_man_ns:
        stands_still(desk, SILENT)
    else:
        twist, problem = desk.period()
        assert problem == ""
        assert twist.any()


@given(axes=deflected)
def test_the_dead_man_acts_in_the_first_period_past_its_time_and_lets_go_with_the_next_report(axes):
    desk = Desk({"deadzone": 0.0})
    desk.hear(axes)
    for _ in range(round(0.1 / PERIOD_S) + 1):
        assert desk.period()[1] == ""
    stands_still(desk, SILENT)
    desk.hear(axes)
    assert desk.period()[1] == ""


def test_who_rests_may_be_silent():
    desk = Desk()
    desk.hear()
    for _ in range(1000):
        stands_still(desk, "")


def test_a_device_that_says_where_may_not_be_silent():
    desk = Desk()
    desk.hear(pose=make_pose(np.array([0.1, 0.0, 0.0]), np.eye(3)))
    for _ in range(round(0.1 / PERIOD_S) + 1):
        assert desk.period()[1] == ""
    stands_still(desk, SILENT)


@given(axes=deflected, leap_ns=st.one_of(st.integers(-(10**12), 0), st.integers(10**9 + 1, 10**15)))
def test_a_clock_that_jumps_moves_nothing_in_that_period_and_says_why(axes, leap_ns):
    desk = Desk({"deadzone": 0.0})
    desk.hear(axes)
    assert desk.period(leap_ns)[0].any()
    desk.hear(axes)
    stands_still(desk, LEAPED)
    # From there on time is what it is now.
    desk.hear(axes)
    assert desk.period()[1] == ""


@given(axes=deflected, ahead_ns=st.integers(1, 10**15))
def test_a_report_from_the_future_moves_nothing(axes, ahead_ns):
    desk = Desk({"deadzone": 0.0})
    desk.hear(axes, age_ns=-ahead_ns)
    stands_still(desk, SILENT)


@given(axes=counts, words=st.text(min_size=1))
def test_a_device_that_is_not_sound_moves_nothing_and_its_own_words_are_said(axes, words):
    desk = Desk()
    desk.hear(axes, problem=words)
    stands_still(desk, words)
    desk.hear([350, 0, 0, 0, 0, 0])
    assert desk.period()[0][0] == pytest.approx(0.2)


@pytest.mark.parametrize(
    "pose",
    [
        np.full(7, np.nan),
        np.array([np.inf, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]),
        np.array([0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0]),
        np.zeros(7),
    ],
)
def test_what_is_no_pose_moves_nothing(pose):
    desk = Desk()
    desk.hear(pose=pose)
    stands_still(desk, "its pose is none")


@given(settings=maps, start=places, said=st.lists(places, min_size=1, max_size=8))
def test_a_device_that_says_where_moves_the_target_no_faster_than_one_that_says_how_fast(settings, start, said):
    desk = Desk(settings, target=pose_of(start))
    for pose in map(pose_of, said):
        before = desk.follower.target_pose
        desk.hear(pose=pose)
        twist, _ = desk.period()
        after = desk.follower.target_pose
        assert np.linalg.norm(twist[:3]) <= desk.map.linear_max_m_s * ROUNDING
        assert np.linalg.norm(twist[3:]) <= desk.map.angular_max_rad_s * ROUNDING
        # It comes nearer, straight, and never goes past.
        way, gone = pose[:3] - before[:3], after[:3] - before[:3]
        reach_m = min(np.linalg.norm(way), desk.map.linear_max_m_s * PERIOD_S)
        np.testing.assert_allclose(gone, reach_m * way / max(np.linalg.norm(way), 1e-12), atol=1e-12)
        left, was = (
            Rotation.from_matrix(rotation_of(pose[3:]) @ rotation_of(at[3:]).T).magnitude() for at in (after, before)
        )
        reach_rad = min(was, desk.map.angular_max_rad_s * PERIOD_S)
        assert left == pytest.approx(was - reach_rad, abs=1e-7)


@given(seed=st.integers(0, 2**32 - 1), settings=maps.map(lambda each: {**each, "linear_max_m_s": 0.2}))
def test_a_mouse_that_is_steered_brings_the_target_where_it_is_wanted(seed, settings):
    rng, desk, mouse = np.random.default_rng(seed), Desk(settings), EmulatedSpaceMouse()
    wanted = make_pose(rng.uniform(-0.01, 0.01, 3), exp_so3(rng.uniform(-0.0004, 0.0004, 3)))
    for _ in range(60):
        steer_to(mouse, desk.follower.record, wanted[:3], rotation_of(wanted[3:]))
        desk.follower.take(mouse.read(desk.now_ns))
        desk.period()
    # To what a count is worth in a period.
    near = PERIOD_S / ((1.0 - desk.map.deadzone) * 350)
    at = desk.follower.target_pose
    np.testing.assert_allclose(at[:3], wanted[:3], atol=0.2 * near)
    left = Rotation.from_matrix(rotation_of(wanted[3:]) @ rotation_of(at[3:]).T).as_rotvec()
    np.testing.assert_allclose(left, 0.0, atol=desk.map.angular_max_rad_s * near + 1e-9)


def anything(rng):
    """Bytes that a device might send: garbage of any length, reports of any sort, and sound ones that push hard."""
    kind = rng.integers(5)
    if kind == 0:
        return rng.integers(0, 256, rng.integers(0, 20)).astype(np.uint8)
    if kind == 1:  # The first byte of a report, and then anything.
        head = rng.integers(1, 4)
        return np.append(head, rng.integers(0, 256, rng.choice([1, 6, 12]))).astype(np.uint8)
    axes = rng.choice([-2000, -350, -30, 0, 30, 350, 2000], 6).astype(np.int64)
    if kind == 2:
        first, second = np.zeros((2, 7), np.uint8)
        encode_split(axes, first, second)
        return first if rng.integers(2) else second
    report = np.zeros(13, np.uint8)
    encode_motion(axes, report)
    return report


def downward(rng):
    """A hand that lies on the puck."""
    report = np.zeros(13, np.uint8)
    encode_motion(np.array([0, 0, -350, 0, 0, 0]), report)
    return report


def shaken(place, seed, send=anything, **arena):
    """A second of what `send` makes, at an arm; returns the arena, its trace, and how often the target moved."""
    rng, arena, mouse = np.random.default_rng(seed), Arena(place, seed, **arena), EmulatedSpaceMouse()
    follower = Follower(
        TwistMap(), Impedance(), arena.controller.target_pose, full_scale_counts=350, ticks=PERIOD_TICKS
    )
    moves = 0

    def script():
        nonlocal moves
        while True:
            for _ in range(rng.integers(0, 4)):
                mouse.send(send(rng).tobytes())
            now_ns = int(arena.controller.obs[0]["t_ns"]) + 1_000_000
            follower.take(mouse.read(now_ns))
            follower.move(now_ns, arena.controller)
            moves += bool(follower.twist.any())
            yield PERIOD_TICKS

    trace = arena.play(script(), ticks=1000)
    return arena, trace, moves


@examples(max_examples=6)
@given(seed=st.integers(0, 2**16), place=st.sampled_from(["free", "wall", "sliding", "hole"]), noisy=st.booleans())
def test_no_bytes_get_past_the_safety_layer(seed, place, noisy):
    arena, trace, moves = shaken(place, seed, noisy=noisy)
    assert 20 < moves < 200
    assert [str(each) for each in check(arena, trace) if not each.holds] == []


def test_bytes_would_get_past_a_layer_without_a_leash():
    arena, trace, _ = shaken("wall", 0, downward, without=("leash",))
    assert any(each.name.startswith("I10 leash") for each in check(arena, trace) if not each.holds)
