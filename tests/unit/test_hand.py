"""The emulated person: fast and slow ways agree, equal seeds are equal people, and a hand is what its docs say."""

from dataclasses import fields, replace

import numpy as np
import pytest

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.devices.emulated_spacemouse import FULL_SCALE_COUNTS, EmulatedSpaceMouse
from wrenchflow.collect.devices.hid_report import SOUND, decode
from wrenchflow.collect.follow import Follower
from wrenchflow.collect.hand import WHITE_WIDTH
from wrenchflow.collect.hand_loop import decide
from wrenchflow.collect.profiles import PROFILES, Profile, make_hand, person_of
from wrenchflow.collect.session import Session, demonstrate
from wrenchflow.control.records import CTL, OBS, REQ
from wrenchflow.sim.attempt import DEMONSTRATE, Attempt
from wrenchflow.sim.tasks import scenery
from wrenchflow.spatial import make_pose

EMULATED = CollectConfig(operator="emulated")
PERIOD_TICKS, PERIOD_S = 5, 0.005
TICK_NS = 1_000_000
OFF_M = np.array([0.5008, 0.0005, 0.1])  # On the surface, beside the goal.
R_GOAL = np.diag([1.0, -1.0, -1.0])  # z into the surface.
GOAL_M = np.array([0.5, 0.0, 0.1])
# Somebody without anything that is drawn.
EXACT = Profile(crosstalk=0.0, motor_noise=0.0, tremor=0.0, feel_noise=0.0, eye_m=0.0, stroke_miss=0.0, bow=0.0)


class Person:
    """A hand at an arm that is where its target is, or cannot move, and feels what it is told to feel."""

    def __init__(self, profile, start_m, *, seed=0, periods=400, stuck=False):
        self.hand = make_hand(profile, EMULATED, np.random.default_rng(seed))
        self.hand["goal_x"], self.hand["goal_R"] = GOAL_M, R_GOAL
        self.hand["disturbance_m"] = 0.0
        self.follower = Follower(
            EMULATED.twist_map,
            EMULATED.impedance,
            make_pose(np.array(start_m), R_GOAL),
            full_scale_counts=FULL_SCALE_COUNTS,
            ticks=PERIOD_TICKS,
        )
        self.teleop, self.stuck = self.follower.record, stuck
        self.white = np.random.default_rng((seed, 1)).standard_normal((periods, WHITE_WIDTH))
        self.obs, self.req, self.ctl = (np.zeros(1, dtype) for dtype in (OBS, REQ, CTL))
        self.obs["t_ns"], self.obs["x"], self.obs["R"] = 10**18, start_m, R_GOAL

    def period(self, press_n=0.0, seen_m=(0.0, 0.0, 0.0)):
        """One report, at this press, the arm seen beside where it is; returns what the hand does to the puck."""
        if not self.stuck:
            self.obs["x"], self.obs["R"] = self.teleop["x"], self.teleop["R"]
        where = self.obs["x"].copy()
        self.obs["x"] += seen_m
        self.ctl["wrench"][0, 2] = -press_n
        decide(self.hand, self.white, self.teleop, self.obs, self.req, self.ctl)
        self.obs["x"] = where
        self.obs["t_ns"] += PERIOD_TICKS * TICK_NS
        return self.hand["physical"][0].copy()


def session_of(config, index=0):
    task, rig, model = scenery(config.task, config.rig)
    attempt = Attempt(task, model, rig, config, seed=(config.seed, index, DEMONSTRATE))
    return attempt, Session(attempt, config)


@pytest.mark.parametrize("task", ["peg-insertion", "surface-wiping", "connector-insertion"])
def test_many_periods_at_once_are_the_periods_one_by_one_to_the_bit(task):
    config = replace(EMULATED, task=task)
    (fast_attempt, fast), (slow_attempt, slow) = session_of(config), session_of(config)
    fast.run()
    while not slow_attempt.over:
        slow.period()
    assert fast_attempt.outcome == slow_attempt.outcome
    assert fast_attempt.plant.recorded.tobytes() == slow_attempt.plant.recorded.tobytes()
    assert fast.phases() == slow.phases()
    for name, stream in fast.streams().items():
        assert stream.t.tobytes() == slow.streams()[name].t.tobytes(), name
        assert stream.data.tobytes() == slow.streams()[name].data.tobytes(), name


def test_an_attempt_that_runs_out_of_time_ends_at_the_same_tick_either_way(monkeypatch):
    # Somebody who never presses finds nothing, until the time is over.
    config = replace(EMULATED, profiles=("gentle",))
    monkeypatch.setitem(_profiles(monkeypatch), "gentle", replace(PROFILES["gentle"], press=1e-3, pace=0.05))
    (fast_attempt, fast), (slow_attempt, slow) = session_of(config), session_of(config)
    fast.run()
    while not slow_attempt.over:
        slow.period()
    assert not fast_attempt.outcome.success
    assert fast_attempt.outcome == slow_attempt.outcome
    assert fast_attempt.plant.recorded.tobytes() == slow_attempt.plant.recorded.tobytes()


def _profiles(monkeypatch):
    people = dict(PROFILES)
    monkeypatch.setattr("wrenchflow.collect.profiles.PROFILES", people)
    return people


def bytes_of(episode):
    return {name: stream.data.tobytes() for name, stream in episode.streams.items()}


def test_equal_seeds_are_equal_bytes_and_another_episode_is_another_day():
    config = replace(EMULATED, profiles=("brisk",))
    first, again, other = demonstrate(0, config), demonstrate(0, config), demonstrate(1, config)
    assert bytes_of(first) == bytes_of(again)
    assert first.meta["person"] == again.meta["person"]
    assert bytes_of(first) != bytes_of(other)
    assert first.meta["person"]["profile"] == other.meta["person"]["profile"] == "brisk"
    traits = [field.name for field in fields(Profile)]
    assert all(first.meta["person"][trait] != other.meta["person"][trait] for trait in traits)


def test_different_people_do_the_same_scene_in_ways_of_their_own():
    at_work = {name: demonstrate(0, replace(EMULATED, profiles=(name,))) for name in PROFILES}
    starts = {episode["tcp_pose"].data[0].tobytes() for episode in at_work.values()}
    assert len(starts) == 1
    assert len({episode["target_pose"].data.tobytes() for episode in at_work.values()}) == len(PROFILES)
    assert len({len(episode["tcp_pose"]) for episode in at_work.values()}) == len(PROFILES)


def test_people_take_turns_and_each_is_near_what_is_usual():
    names = [person_of(EMULATED, index)[0] for index in range(2 * len(PROFILES))]
    assert names == 2 * list(PROFILES)
    days = [person_of(replace(EMULATED, profiles=("novice",)), index)[1] for index in range(200)]
    for trait in ("pace", "press", "delay_s", "tremor_hz"):
        ratio = np.array([getattr(day, trait) for day in days]) / getattr(PROFILES["novice"], trait)
        assert np.median(ratio) == pytest.approx(1.0, abs=0.05)
        assert np.std(np.log(ratio)) == pytest.approx(0.12, rel=0.2)


@pytest.mark.parametrize("name", PROFILES)
@pytest.mark.parametrize("sense", ["press_n", "seen_m"])
def test_what_is_felt_or_seen_for_a_moment_changes_nothing_before_the_delay_is_over(name, sense):
    profile, at = PROFILES[name], 100
    impulse = {"press_n": 9.0} if sense == "press_n" else {"press_n": 3.0, "seen_m": (0.001, 0.0, 0.0)}
    calm, struck = (Person(profile, OFF_M, stuck=True) for _ in range(2))
    differ = []
    for period in range(at + 80):
        a, b = calm.period(3.0), struck.period(**(impulse if period == at else {"press_n": 3.0}))
        differ.append(bool((a != b).any()))
    first = differ.index(True)
    assert first - at == round(profile.delay_s / PERIOD_S)
    assert all(differ[first:])


@pytest.mark.parametrize("name", PROFILES)
def test_the_bytes_of_a_report_are_what_the_device_is_read_to_say(name):
    person, mouse = Person(PROFILES[name], GOAL_M - [0.03, -0.02, 0.1 * R_GOAL[2, 2]]), EmulatedSpaceMouse()
    axes, buttons, moved = np.zeros(6, np.int64), np.zeros(1, np.int64), 0
    for period in range(200):
        person.period()
        report = person.hand["report"][0]
        assert decode(report, report.size, axes, buttons) == SOUND
        np.testing.assert_array_equal(axes, person.hand["counts"][0])
        np.testing.assert_array_equal(axes, person.follower.counts)
        mouse.send(report.tobytes())
        reading = mouse.read(period + 1)
        np.testing.assert_array_equal(reading.counts, axes)
        assert reading.problem == ""
        moved += bool(axes.any())
    assert moved > 100


@pytest.mark.parametrize("name", PROFILES)
def test_tremor_lies_between_8_and_12_hz(name):
    periods = 8000
    # A grip so slow that nothing is meant.
    profile = replace(EXACT, tremor=PROFILES[name].tremor, tremor_hz=PROFILES[name].tremor_hz, grip_s=1e9)
    person = Person(profile, OFF_M, periods=periods, stuck=True)
    shaken = np.array([person.period(3.0) for _ in range(periods)])
    np.testing.assert_allclose(shaken.std(0), profile.tremor, rtol=0.15)
    power = (np.abs(np.fft.rfft(shaken * np.hanning(periods)[:, None], axis=0)) ** 2).mean(1)
    hz = np.fft.rfftfreq(periods, PERIOD_S)
    near = (hz >= 8.0) & (hz <= 12.0)
    assert power[near].sum() > 0.55 * power.sum()
    middle = (hz * power)[hz < 20].sum() / power[hz < 20].sum()
    assert middle == pytest.approx(profile.tremor_hz, abs=0.5)


def stroke_of(profile, start_m):
    """What the hand wants, and where the target goes, in the first stroke from a place. Shapes (n, 3)."""
    person = Person(profile, start_m)
    wanted, gone, record = [], [], person.hand[0]
    while True:
        person.period()
        if record["strokes"] > 1 or not (record["is_stroke"] or len(wanted) == 0):
            return np.array(wanted), np.array(gone), record
        wanted.append(record["x"].copy())
        gone.append(person.teleop["x"][0].copy())


def test_a_stroke_without_noise_is_of_minimum_jerk():
    start = GOAL_M + [0.03, -0.04, 0.06]
    wanted, gone, record = stroke_of(EXACT, start)
    way = record["stroke_to"] - record["stroke_from"]
    np.testing.assert_allclose(record["stroke_from"], start, atol=1e-12)
    # Straight to a place just above the goal: nothing is missed.
    assert np.linalg.norm(record["stroke_to"] - GOAL_M) < 0.004
    s = np.minimum(np.arange(1, len(wanted) + 1) * PERIOD_S / record["stroke_T"], 1.0)
    # Its sixth derivative is zero, and it begins and ends at rest: the polynomial of the books.
    exact = start + np.outer(np.polyval([6.0, -15.0, 10.0, 0.0, 0.0, 0.0], s), way)
    np.testing.assert_allclose(wanted, exact, atol=1e-12)
    speed = np.linalg.norm(np.diff(gone, axis=0), axis=1) / PERIOD_S
    # The hand that does it is late and blurs it, but it stays one bell, no faster than the person's pace.
    smooth = np.convolve(speed, np.ones(5) / 5, "valid")
    top = int(smooth.argmax())
    assert (np.diff(smooth[: top + 1]) > -1e-3).all()
    assert (np.diff(smooth[top:]) < 1e-3).all()
    assert speed.max() < 1.1 * record["skill"]["speed_m_s"]


def test_a_stroke_takes_longer_for_each_bit_of_difficulty():
    times = []
    for far in (0.012, 0.024, 0.048):
        _, _, record = stroke_of(replace(EXACT, pace=100.0), GOAL_M + [0.0, 0.0, 0.002 + far])
        times.append(float(record["stroke_T"]))
    bits = np.log2(1.0 + np.array([0.012, 0.024, 0.048]) / 0.003)
    # Nothing but the pace bounds it, so the law alone is left.
    np.testing.assert_allclose(np.diff(times), 0.08 * np.diff(bits), rtol=0.01)


def test_a_bow_goes_aside_and_comes_back():
    start = GOAL_M + [0.03, -0.04, 0.06]
    wanted, _, record = stroke_of(replace(EXACT, bow=0.3), start)
    straight, _, _ = stroke_of(EXACT, start)
    along = (record["stroke_to"] - record["stroke_from"]) / np.linalg.norm(record["stroke_to"] - record["stroke_from"])
    off = wanted - start - np.outer((wanted - start) @ along, along)
    np.testing.assert_allclose(wanted[-1], straight[-1], atol=1e-12)
    aside = np.linalg.norm(off, axis=1)
    assert 0.1 < aside.max() / np.linalg.norm(record["stroke_to"] - start) <= 0.3 * (1.0 + 1e-9)


ABOVE_M = GOAL_M + [0.03, -0.04, 0.06]


def puck(profile, start_m, periods, *, seed=0, change=None):
    """What a hand does to the puck of an arm that cannot move, period by period. Shape (n, 6)."""
    person = Person(profile, start_m, seed=seed, periods=periods, stuck=True)
    if change is not None:
        change(person)
    return np.array([person.period(3.0) for _ in range(periods)])


def test_the_noise_of_a_hand_grows_with_what_it_does():
    def deflect(share):
        def change(person):
            person.hand["grip_s"] = 1e9  # Nothing but what is set here is meant.
            person.hand["hand_s"] = 1e9
            person.hand["deflection"] = share

        return change

    spread = [
        puck(replace(EXACT, motor_noise=0.1), OFF_M, 4000, change=deflect(share)).std(0) for share in (0.0, 0.2, 0.4)
    ]
    np.testing.assert_allclose(spread[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(spread[2], 2.0 * spread[1], rtol=0.03)
    # The deadzone takes its share of full deflection from what the hand does beyond it.
    np.testing.assert_allclose(spread[1] / 0.2, 0.1 * (1.0 - EMULATED.twist_map.deadzone), rtol=0.25)


def test_the_noise_of_a_hand_lasts_for_some_periods_and_is_of_its_own_on_each_axis():
    def deflect(person):
        person.hand["grip_s"], person.hand["hand_s"], person.hand["deflection"] = 1e9, 1e9, 0.4

    noise = puck(replace(EXACT, motor_noise=0.1), OFF_M, 8000, change=deflect)
    noise -= noise.mean(0)
    lag = 4
    kept = (noise[:-lag] * noise[lag:]).mean(0) / (noise**2).mean(0)
    # An Ornstein-Uhlenbeck process of 50 ms.
    np.testing.assert_allclose(kept, np.exp(-lag * PERIOD_S / 0.05), atol=0.12)
    between = np.corrcoef(noise.T) - np.eye(6)
    assert np.abs(between).max() < 0.2


def test_what_is_meant_for_one_axis_leaks_into_the_others_by_the_hands_own_matrix():
    shares = np.zeros((6, 6))

    def deflect(person):
        person.hand["grip_s"], person.hand["hand_s"] = 1e9, 1e9
        person.hand["deflection"] = [0.3, 0.0, 0.0, 0.0, 0.0, 0.0]
        shares[:] = person.hand["crosstalk"][0]

    leaked = puck(replace(EXACT, crosstalk=0.2), OFF_M, 2, change=deflect)[-1]
    dead = EMULATED.twist_map.deadzone
    meant = 0.3 * (np.eye(6) + shares)[:, 0]
    np.testing.assert_allclose(leaked, (1.0 - dead) * meant + dead * np.tanh(meant / 0.005), atol=1e-6)
    assert (np.abs(shares - np.diag(np.diag(shares))).sum(1) > 0.0).all()


@pytest.mark.parametrize(("trait", "value"), [("feel_noise", 0.08), ("eye_m", 0.0004)])
def test_feeling_and_eye_err_slowly_and_by_as_much_as_the_profile_says(trait, value):
    periods, lag = 16000, 20
    person = Person(replace(EXACT, **{trait: value}), OFF_M, periods=periods, stuck=True)
    seen = []
    for _ in range(periods):
        person.period(5.0)
        record = person.hand[0]["seen"]
        # With an eye that errs the tool seems to be elsewhere; with a feeling that errs, the press another one.
        seen.append([record["wrench"][2] / 5.0, record["wrench_slow"][2] / 5.0, *record["x"][:2]])
    seen = np.array(seen)[1000:]
    seen -= seen.mean(0)
    erring, exact = (seen[:, :2], seen[:, 2:]) if trait == "feel_noise" else (seen[:, 2:], seen[:, :2])
    np.testing.assert_allclose(erring.std(0), value, rtol=0.35)
    np.testing.assert_allclose(exact, 0.0, atol=1e-6)
    kept = (erring[:-lag] * erring[lag:]).mean(0) / (erring**2).mean(0)
    np.testing.assert_allclose(kept, np.exp(-lag * PERIOD_S / 0.5), atol=0.1)


def test_a_press_is_felt_at_once_and_a_steady_one_is_judged_over_50_ms():
    person = Person(EXACT, OFF_M, stuck=True)
    for _ in range(100):
        person.period(2.0)
    fast, slow = [], []
    for _ in range(100):
        person.period(8.0)
        fast.append(person.hand[0]["seen"]["wrench"][2])
        slow.append(person.hand[0]["seen"]["wrench_slow"][2])
    rises = int(np.argmax(np.array(fast) > 5.0))
    assert fast[rises] == pytest.approx(8.0)
    assert slow[rises] < 4.0
    # A first-order lag of 50 ms.
    assert slow[rises + 10] == pytest.approx(8.0 - 6.0 * np.exp(-1.0), abs=0.4)
    assert slow[-1] == pytest.approx(8.0, abs=0.1)


def test_who_may_miss_falls_short_and_ends_beside_as_far_as_the_profile_says():
    ends = []
    for seed in range(80):
        person = Person(replace(EXACT, stroke_miss=0.1), ABOVE_M, seed=seed, periods=2)
        person.period()
        ends.append(person.hand[0]["stroke_to"].copy())
    aims = stroke_of(EXACT, ABOVE_M)[2]["stroke_to"]
    way = aims - ABOVE_M
    off = np.array(ends) - (ABOVE_M + 0.75 * way)
    # A quarter of the way is left, and what is missed is a tenth of it on each axis.
    np.testing.assert_allclose(off.mean(0), 0.0, atol=0.035 * np.linalg.norm(way))
    np.testing.assert_allclose(off.std(0), 0.1 * np.linalg.norm(way), rtol=0.3)


def test_a_hand_rests_between_two_strokes():
    person = Person(replace(EXACT, stroke_miss=0.06, stroke_rest_s=0.3), ABOVE_M, periods=800)
    active = []
    for _ in range(800):
        person.period()
        active.append((int(person.hand[0]["strokes"]), bool(person.hand[0]["is_stroke"])))
        if active[-1][0] == 2:
            break
    assert active[-1][0] == 2
    rested = sum(1 for strokes, is_stroke in active if strokes == 1 and not is_stroke)
    assert rested * PERIOD_S == pytest.approx(0.3, abs=0.02)


def test_counts_are_the_nearest_whole_numbers_of_what_the_puck_does():
    person = Person(PROFILES["novice"], ABOVE_M)
    for _ in range(200):
        physical = person.period()
        record, teleop = person.hand[0], person.teleop[0]
        said = record["counts"][teleop["axis"]] * teleop["sign"]
        exact = np.clip(physical, -1.0, 1.0) * teleop["full_scale"]
        assert np.abs(said - exact).max() <= 0.5 + 1e-9


def test_an_arm_is_disturbed_on_each_axis_by_as_much_as_is_configured():
    person = Person(EXACT, OFF_M, periods=16000, stuck=True)
    person.hand["disturbance_m"], person.hand["disturbance_s"] = 0.0003, 0.2
    moved = []
    for _ in range(16000):
        person.period(3.0)
        moved.append(person.teleop["x_offset"][0].copy())
    moved = np.array(moved)
    np.testing.assert_allclose(moved.std(0), 0.0003, rtol=0.2)
    assert np.abs(np.corrcoef(moved.T) - np.eye(3)).max() < 0.25
