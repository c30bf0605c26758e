"""Wiping: contact where the surface is, scenes as they are said, a referee who counts, and an operator who can."""

import mujoco
import numpy as np
import pytest

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import Session
from wrenchflow.collect.skills.decide import skill_of, want
from wrenchflow.collect.skills.skill import PERCEIVED, WANTED
from wrenchflow.control.config import Impedance
from wrenchflow.sim.attempt import DEMONSTRATE, Attempt
from wrenchflow.sim.reach import joints_at
from wrenchflow.sim.tasks import scenery
from wrenchflow.sim.tasks.wiping_path import BEGIN_M, END_M, aside, slope
from wrenchflow.spatial import compose, exp_so3, inverse, log_so3, make_pose, rotation_of

CONFIG = CollectConfig(task="surface-wiping", device_hz=100)
TASK, RIG, MODEL = scenery("surface-wiping")
EVEN = TASK.evenness


def scene_of(seed: int):
    return TASK.draw(MODEL, np.random.default_rng(seed))


def on(T_base_goal: np.ndarray, along: float, across: float | None = None, depth_m: float = 0.0) -> np.ndarray:
    """A pose of a level tool over the way, in the base frame."""
    beside = aside(along) if across is None else across
    return compose(T_base_goal, make_pose(np.array([along, beside, depth_m]), np.eye(3)))


# The way


def test_the_way_is_an_s_that_goes_on_along_x():
    x = np.linspace(-0.02, END_M + 0.03, 2001)
    y = np.array([aside(at) for at in x])
    np.testing.assert_allclose(np.gradient(y, x)[1:-1], [slope(at) for at in x[1:-1]], atol=1e-4)
    way = y[(x >= BEGIN_M) & (x <= END_M)]
    assert way.max() == pytest.approx(-way.min(), rel=1e-3)
    assert 0.008 < way.max() < 0.012
    length_m = np.hypot(np.diff(x), np.diff(y))[(x[1:] > BEGIN_M) & (x[1:] <= END_M)].sum()
    assert 0.12 < length_m < 0.16
    assert aside(0.0) == 0.0  # The tool lands on it.


# The surface


def overlap_m(scene, pose: np.ndarray) -> float:
    data = mujoco.MjData(MODEL)
    TASK.place(MODEL, data, scene)
    data.qpos[:] = joints_at(MODEL, pose)
    mujoco.mj_forward(MODEL, data)
    assert data.ncon <= 1  # One contact, or it would chatter between two.
    return float(-min([0.0, *data.contact.dist]))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("along", [-0.02, 0.0, BEGIN_M, 0.09, END_M, END_M + 0.02])
def test_contact_is_where_the_surface_is_and_not_where_it_seems(seed, along):
    scene = scene_of(seed)
    assert overlap_m(scene, on(scene.T_base_goal, along, depth_m=-2e-5)) == 0.0
    assert overlap_m(scene, on(scene.T_base_goal, along, depth_m=0.0005)) == pytest.approx(0.0005, abs=1e-7)


def test_a_tilted_pad_touches_earlier_by_no_more_than_its_roundness():
    scene = scene_of(0)
    for tilt_rad in (-0.1, 0.05, 0.1):
        pose = make_pose(
            scene.T_base_goal[:3], rotation_of(scene.T_base_goal[3:]) @ exp_so3(np.array([tilt_rad, 0.0, 0.0]))
        )
        earlier_m = TASK.pad_radius_m * (1.0 - np.cos(tilt_rad))
        into = rotation_of(scene.T_base_goal[3:])[:, 2]
        for deeper_m, touches in ((-2e-5, False), (2e-5, True)):
            moved = pose.copy()
            moved[:3] += (deeper_m - earlier_m) * into
            assert (overlap_m(scene, moved) > 0.0) == touches


def test_scenes_are_drawn_within_their_ranges():
    scenes = [scene_of(seed) for seed in range(150)]
    seems = np.array([scene.T_base_goal_perceived for scene in scenes])
    goals = np.array([scene.T_base_goal for scene in scenes])
    offsets = seems[:, :3] - TASK.centre_m
    assert np.abs(offsets[:, :2]).max() <= 0.025
    assert np.abs(offsets[:, :2]).max() > 0.023
    assert (offsets[:, 2] == 0.0).all()
    np.testing.assert_allclose(rotation_of(seems[:, 3:])[:, :, 2], np.tile([0.0, 0.0, -1.0], (150, 1)), atol=1e-12)
    along = rotation_of(seems[:, 3:])[:, :, 0]
    yaw_rad = np.arctan2(along[:, 0], along[:, 1])  # The way goes along the base's y, more or less.
    assert np.radians(13.0) < np.abs(yaw_rad).max() <= np.radians(15.0)
    wrong = goals - seems
    assert (wrong[:, :2] == 0.0).all()
    assert 0.009 < np.abs(wrong[:, 2]).max() <= 0.010
    turn = log_so3(rotation_of(goals[:, 3:]) @ np.swapaxes(rotation_of(seems[:, 3:]), -1, -2))
    np.testing.assert_allclose(turn[:, 2], 0.0, atol=1e-12)
    tilt_rad = np.linalg.norm(turn, axis=1)
    assert np.radians(4.5) < tilt_rad.max() <= np.radians(5.0)


def test_the_tool_starts_above_the_run_in_whatever_the_height():
    for seed in range(30):
        scene, data = scene_of(seed), mujoco.MjData(MODEL)
        TASK.place(MODEL, data, scene)
        from_goal = data.site("tcp").xpos - scene.T_base_goal_perceived[:3]
        assert np.abs(from_goal[:2]).max() <= 0.020 + 1e-9 < BEGIN_M
        assert 0.035 - 1e-9 <= from_goal[2] <= 0.055 + 1e-9


def test_the_contact_zone_holds_the_whole_way_however_the_surface_lies():
    for seed in range(50):
        scene = scene_of(seed)
        low, high = TASK.contact_zone(scene)
        for along in np.linspace(0.0, END_M, 7):
            place = on(scene.T_base_goal, along)[:3]
            assert (low < place).all()
            assert (place < high).all()


# The referee


class Run:
    """What a referee sees of a tool that goes along the way, to be spoilt at places."""

    def __init__(self, seed: int = 1, samples: int = 800, from_m: float = 0.0, to_m: float = END_M + 0.002):
        self.scene = scene_of(seed)
        self.along = np.linspace(from_m, to_m, samples)
        self.across = np.array([aside(at) for at in self.along])
        self.press_n = np.full(samples, 8.0)

    def between(self, from_share: float, to_share: float) -> np.ndarray:
        share = (self.along - BEGIN_M) / (END_M - BEGIN_M)
        return (share >= from_share) & (share < to_share)

    def seen(self) -> tuple[np.ndarray, np.ndarray]:
        goal = self.scene.T_base_goal
        places = np.stack([self.along, self.across, np.zeros(len(self.along))], axis=-1)
        poses = compose(goal, make_pose(places, np.broadcast_to(np.eye(3), (len(places), 3, 3))))
        into = rotation_of(goal[3:])[:, 2]
        return poses, np.concatenate([self.press_n[:, None] * into, np.zeros((len(poses), 3))], axis=1)

    def judged(self, pieces: int = 1):
        referee = TASK.referee(self.scene)
        for poses, wrenches in zip(*(np.array_split(part, pieces) for part in self.seen()), strict=True):
            referee.see(poses, wrenches)
        return referee


def test_an_even_way_is_a_success_at_its_end_and_not_before():
    assert Run().judged().progress == 1.0
    short = Run(to_m=END_M - 0.0005).judged()
    assert 0.97 < short.progress < 1.0
    assert (short.is_lost, short.failure) == (False, "timeout")
    half = Run(to_m=0.5 * (BEGIN_M + END_M)).judged()
    assert half.progress == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("pieces", [2, 7, 800])
def test_the_verdict_does_not_depend_on_how_the_samples_come(pieces):
    run = Run()
    run.press_n[run.between(0.2, 0.25)] = 10.5
    whole, parts = run.judged(), run.judged(pieces)
    assert (whole.progress, whole.is_lost, whole.failure) == (parts.progress, parts.is_lost, parts.failure)


def spoil(run: Run, how: str, where: np.ndarray) -> None:
    if how == "off-path":
        run.across[where] += 0.007
    else:
        run.press_n[where] = {"uneven": 5.8, "lifted": 0.5}[how]


@pytest.mark.parametrize("how", ["uneven", "lifted", "off-path"])
def test_a_tenth_of_the_way_may_be_spoilt_and_no_more(how):
    little, much = Run(), Run()
    spoil(little, how, little.between(0.4, 0.48))
    spoil(much, how, much.between(0.4, 0.52))
    assert little.judged().progress == 1.0
    referee = much.judged()
    assert referee.progress < 0.9
    assert (referee.is_lost, referee.failure) == (True, how)
    assert how in TASK.failures


@pytest.mark.parametrize("wrong_n", [-2.1, 2.1])
def test_one_wrong_sample_spoils_its_element_and_a_small_error_none(wrong_n):
    whole = Run(to_m=END_M - 0.0005).judged().progress
    run = Run(to_m=END_M - 0.0005)
    run.press_n[400] += wrong_n
    assert whole - run.judged().progress == pytest.approx(1.0 / 60.0, rel=0.2)
    run.press_n[400] -= 0.2 * np.sign(wrong_n)
    assert run.judged().progress == whole


def test_what_is_spoilt_stays_so_when_it_is_wiped_again():
    run, again = Run(to_m=0.1), Run()
    spoil(run, "uneven", run.between(0.2, 0.4))
    referee = run.judged()
    referee.see(*again.seen())
    assert (referee.is_lost, referee.failure) == (True, "uneven")


def test_force_counts_along_the_true_normal():
    run = Run(seed=2)
    poses, wrenches = run.seen()
    sideways = rotation_of(run.scene.T_base_goal[3:])[:, 0]
    referee = TASK.referee(run.scene)
    referee.see(poses, wrenches + np.concatenate([3.0 * sideways, np.zeros(3)]))
    assert referee.progress == 1.0
    upright = TASK.referee(run.scene)
    upright.see(poses, np.tile([0.0, 0.0, -8.0 - EVEN.band_n, 0, 0, 0], (len(poses), 1)))
    assert upright.progress == 1.0  # The same force along the vertical is less along the normal.


def test_the_way_through_the_air_spoils_nothing():
    air, run = Run(), Run()
    air.press_n[:] = 0.0
    referee = air.judged()
    assert (referee.progress, referee.is_lost, referee.failure) == (0.0, False, "timeout")
    referee.see(*run.seen())
    assert referee.progress == 1.0


def test_a_way_of_which_the_beginning_is_left_out_is_lost_at_its_end():
    referee = Run(from_m=BEGIN_M + 0.03).judged()
    assert (referee.is_lost, referee.failure) == (True, "lifted")


def test_too_much_force_ends_it_wherever_it_is():
    run = Run()
    run.press_n[10] = EVEN.force_max_n + 0.1
    referee = run.judged()
    assert (referee.is_lost, referee.failure) == (True, "over-force")
    assert referee.progress < 1.0


# The skill


def wanted_at(along: float, press_n: float, depth_m: float = 0.0, across: float | None = None) -> np.ndarray:
    """What the skill wants of a tool there: x y z in the goal's axes, and the phase."""
    number, skill = skill_of("surface-wiping", Impedance())
    seen, wanted = np.zeros(1, PERCEIVED), np.zeros(1, WANTED)
    seen["x"] = along, aside(along) if across is None else across, depth_m
    seen["R"], seen["wrench"][0, 2] = np.eye(3), press_n
    want(number, skill[0], seen[0], wanted[0])
    return np.array([*wanted[0]["x"], wanted[0]["phase"]])


def test_the_skill_presses_with_the_spring_and_corrects_what_it_feels():
    stiffness = Impedance().translation_n_m
    pressed = {press: wanted_at(0.09, press)[2] * stiffness for press in (3.0, 7.0, 8.0, 9.0)}
    assert pressed[8.0] == pytest.approx(8.0)
    assert pressed[9.0] < 8.0 < pressed[7.0]
    assert pressed[3.0] < 9.0  # A soft landing: the press is led only so far.
    assert wanted_at(0.09, 8.0, depth_m=0.004)[2] - 0.004 == pytest.approx(8.0 / stiffness)  # Wherever the surface is.


def test_the_skill_leads_along_the_way_and_waits_for_the_press():
    leads = [wanted_at(0.09, press)[0] - 0.09 for press in (8.0, 6.0, 5.0)]
    assert leads[0] > leads[1] > leads[2] > 0.0
    for along in (0.0, 0.05, 0.1, 0.149):
        ahead, across, _, _ = wanted_at(along, 8.0, across=aside(along) + 0.002)
        assert across == pytest.approx(aside(ahead))


def test_without_contact_the_skill_lands_where_the_way_was_left():
    x, _, z, phase = wanted_at(0.09, 0.0, depth_m=-0.001)
    assert (x, z > -0.001, TASK.phases[int(phase)]) == (0.09, True, "land")
    x, _, _, phase = wanted_at(0.01, 0.0, depth_m=-0.04)
    assert 0.0 <= x < 0.01
    assert TASK.phases[int(phase)] == "approach"


# Together


@pytest.fixture(scope="module")
def attempts() -> list[Attempt]:
    """Some attempts of the scripted operator."""
    made = []
    for index in range(4):
        attempt = Attempt(TASK, MODEL, RIG, CONFIG, seed=(0, index, DEMONSTRATE))
        session = Session(attempt, CONFIG)
        while not attempt.over:
            session.period()
        made.append(attempt)
    return made


def felt(attempt: Attempt) -> tuple[np.ndarray, np.ndarray]:
    """Place along the way [m] and press normal to the surface [N], from the first touch on."""
    seen, goal = attempt.plant.seen, attempt.scene.T_base_goal
    press_n = seen["wrench"][:, :3] @ rotation_of(goal[3:])[:, 2]
    first = int(np.argmax(press_n > EVEN.touch_n))
    return compose(inverse(goal), seen["tcp_pose"])[first:, 0], press_n[first:]


def test_by_feel_every_attempt_is_a_success_in_time(attempts):
    assert [attempt.outcome.failure for attempt in attempts] == [""] * len(attempts)
    assert max(attempt.outcome.duration_s for attempt in attempts) < 0.6 * TASK.time_limit_s


def test_by_feel_it_lands_softly_and_presses_evenly(attempts):
    for attempt in attempts:
        along, press_n = felt(attempt)
        assert press_n.max() < 10.0
        assert press_n[along >= BEGIN_M].min() > EVEN.touch_n  # No chatter: contact is not lost once.
        assert np.sqrt(np.mean((press_n[along >= BEGIN_M] - 8.0) ** 2)) < 0.9


def test_the_end_of_the_way_ends_the_attempt(attempts):
    for attempt in attempts:
        assert END_M <= felt(attempt)[0][-1] < END_M + 0.002


def go(attempt: Attempt, target: np.ndarray, ticks: int) -> None:
    """Move the target there in a straight line."""
    start = attempt.controller.target_pose
    attempt.controller.ask(start, target, ticks=ticks, impedance=attempt.impedance)
    attempt.follow(ticks)


def test_pressed_where_the_surface_seems_to_be_it_is_spoilt():
    """K times what the height is off is what the press is off: 2 N are 3.3 mm."""
    for index in (0, 1, 2):
        attempt = Attempt(TASK, MODEL, RIG, CONFIG, seed=(0, index, DEMONSTRATE))
        seems, deep_m = attempt.scene.T_base_goal_perceived, 8.0 / CONFIG.impedance.translation_n_m
        off_m = [(on(attempt.scene.T_base_goal, along) - on(seems, along))[2] for along in (BEGIN_M, END_M)]
        assert max(np.abs(off_m)) > 0.004
        go(attempt, on(seems, 0.0, depth_m=-0.014), 1600)
        go(attempt, on(seems, 0.0, depth_m=deep_m), 2200)
        for along in np.arange(0.0, END_M + 0.03, 0.002):
            if not attempt.over:
                go(attempt, on(seems, along, depth_m=deep_m), 50)
        assert attempt.outcome.failure in ("uneven", "lifted", "over-force")
