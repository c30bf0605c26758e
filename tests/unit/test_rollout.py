"""A rollout: what the policy saw live is what training computes from the recording, and plans may be late."""

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import jaxtyping
import numpy as np
import pytest

from wrenchflow.control.config import ControlConfig
from wrenchflow.control.packet import MOST_WAYPOINTS
from wrenchflow.control.safeguards import RUN, cause_of
from wrenchflow.datasets.sample import to_steps
from wrenchflow.deploy.config import DeployConfig
from wrenchflow.deploy.link import Link
from wrenchflow.deploy.rollout import Rollout, roll_out
from wrenchflow.describe import describe
from wrenchflow.errors import ConfigError
from wrenchflow.force_filter import FilterConfig
from wrenchflow.policy.config import MlpConfig, PolicyConfig
from wrenchflow.policy.features import ACTION_COLUMNS, ACTION_FLOORS, FORCE_GROUPS, WITH_FORCE, WITHOUT_FORCE, Features
from wrenchflow.policy.learned import LearnedPolicy
from wrenchflow.policy.normaliser import fit_actions, fit_observations
from wrenchflow.policy.policy import Policy, WithoutForceInput
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.pipeline import process_episode
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode
from wrenchflow.sim.attempt import EVALUATE, Attempt
from wrenchflow.sim.config import AttemptConfig
from wrenchflow.told import recording_lines

MS = 1_000_000
# So slow near contact that no blow ends an attempt before its time.
GENTLE = AttemptConfig(control=ControlConfig(zone_speed_m_s=0.03))


@pytest.fixture(scope="module", autouse=True)
def _without_shape_checks() -> Iterator[None]:
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)


@dataclass(eq=False)
class Prodder:
    """Goes for a point below the perceived goal, and a little to a random side; remembers what it was shown."""

    features: Features = field(default_factory=lambda: Features(WITH_FORCE))
    period_ns: int = 50 * MS
    n_obs_steps: int = 2
    horizon: int = 4
    n_action_steps: int = 1
    wrench_filter: FilterConfig = field(default_factory=FilterConfig)
    shown: list[np.ndarray] = field(default_factory=list)

    def act(self, observations, goal_pose, rngs):
        self.shown.append(observations)
        poses = np.repeat(goal_pose[:, None], self.horizon, axis=1)
        poses[..., 2] -= 0.008
        poses[..., :2] += np.stack([rng.normal(size=(self.horizon, 2)) for rng in rngs]) * 0.002
        return poses


@pytest.fixture(scope="module")
def short(peg):
    """The task with little time."""
    return replace(peg, time_limit_s=2.0)


@pytest.fixture
def attempt(short, peg_model, rig):
    return Attempt(short, peg_model, rig, GENTLE, seed=(0, 3, EVALUATE))


def run(attempt: Attempt, policy: Policy, **link: float) -> Rollout:
    rollout = Rollout(attempt, policy, Link(**link))
    while not rollout.over:
        poses = policy.act(rollout.look()[None], rollout.goal_pose[None], [rollout.attempt.rng])
        rollout.plan(poses[0])
        rollout.follow()
    return rollout


@pytest.mark.parametrize(
    ("rate_hz", "latency_ms", "groups", "felt"),
    [
        (20, 0, WITH_FORCE, FilterConfig()),
        (10, 70, WITH_FORCE, FilterConfig()),
        (20, 0, WITHOUT_FORCE, FilterConfig()),
        (20, 0, WITH_FORCE, FilterConfig(cutoff_hz=25.0, order=3, median_samples=5)),
    ],
)
def test_what_the_policy_saw_is_what_training_computes_from_the_file(
    attempt, tmp_path, rate_hz, latency_ms, groups, felt
):
    policy = Prodder(features=Features(groups), period_ns=1000 * MS // rate_hz, wrench_filter=felt)
    rollout = run(attempt, policy, latency_s=1e-3 * latency_ms)
    write_episode(tmp_path / "rollout.mcap", rollout.episode("rollout"))

    clean, _ = process_episode(read_episode(tmp_path / "rollout.mcap"), ProcessConfig(filter=felt))
    steps = to_steps(clean, rate_hz)
    assert steps.wrench_filter == felt
    assert steps.t[0] == attempt.start_ns
    # The last step has no action yet that training could learn.
    assert 0 <= len(rollout.seen) - len(steps) <= 1
    seen = np.stack(rollout.seen)[: len(steps)]
    np.testing.assert_array_equal(seen, policy.features.encode(steps.observations))
    if groups == WITH_FORCE:
        forces = seen[:, policy.features.columns_of("wrench")][:, 2]
        assert np.ptp(forces) > 2.0  # It did touch.


def test_the_policy_is_shown_the_last_steps_oldest_first_and_the_first_one_again_where_there_are_none(attempt):
    policy = Prodder(n_obs_steps=3)
    rollout = run(attempt, policy)
    seen = [rollout.seen[0]] * 2 + rollout.seen
    assert len(policy.shown) == len(rollout.seen) == 40
    for k, shown in enumerate(policy.shown):
        np.testing.assert_array_equal(shown[0], np.stack(seen[k : k + 3]))


def test_a_plan_takes_effect_when_it_arrives_and_only_with_what_lies_ahead_then(attempt):
    episode = run(attempt, Prodder(), latency_s=0.1205).episode("late")
    target, plans = episode["target_pose"], episode.meta["plans"]
    # It arrives at a tick, is followed from there on, and begins at rest: a tick later something moves.
    arrival_ns = attempt.start_ns + 2 * MS + 121 * MS
    moving = np.flatnonzero((np.abs(target.data - target.data[0]) > 1e-12).any(axis=1))
    assert target.t[moving[0]] == arrival_ns + MS
    assert set(plans["age_ticks"]) == {123}
    # Of four waypoints 50 ms apart, two have passed by then; every plan loses them.
    assert (episode.meta["policy"]["steps"], plans["sent"]) == (40, 40)
    assert plans["received"] in (37, 38)
    assert set(plans["dropped"]) == set(plans["kept"]) == {2}
    assert plans["refused"] == {}
    assert np.max(plans["seam_jump_m"][1:]) > 1e-4  # The plans disagree, and the target does not jump.
    assert plans["seam_jump_m"][0] == 0.0


def test_a_plan_that_always_comes_too_late_moves_nothing_and_is_named(attempt):
    episode = run(attempt, Prodder(), latency_s=0.3).episode("too late")
    target, plans = episode["target_pose"], episode.meta["plans"]
    np.testing.assert_allclose(target.data, target.data[:1].repeat(len(target), axis=0), atol=1e-12)
    assert plans["refused"] == {"late": plans["received"]}
    assert sum(plans["dropped"]) == 4 * plans["received"] > 100
    assert episode.meta["safety"]["interventions"]["gate-request"] == plans["received"]


def told_of_plans(path: Path) -> list[str]:
    return [line.split(maxsplit=1)[1] for line in recording_lines(describe(path)) if line.startswith("plans")]


@pytest.mark.parametrize(
    ("link", "said"),
    [
        ({"loss": 1.0}, "40 sent, 40 lost, 0 overtaken, 0 received, 0 refused"),
        (
            {"latency_s": 0.3},
            "40 sent, 0 lost, 0 overtaken, 34 received, 34 refused; 0 waypoints kept, 136 dropped; up to 302 ms old, "
            "seams up to 0.00 mm",
        ),
    ],
)
def test_info_tells_what_became_of_the_plans_where_none_came_to_anything(attempt, tmp_path, link, said):
    episode = run(attempt, Prodder(), **link).episode("rollout")
    write_episode(tmp_path / "rollout.mcap", episode)
    assert describe(tmp_path / "rollout.mcap")["plans"] == episode.meta["plans"]
    assert told_of_plans(tmp_path / "rollout.mcap") == [said]


_FATES = {"sent": 9, "lost": 3, "overtaken": 1, "received": 4, "refused": {"late": 1, "past": 1}}
_ROWS = {"age_ticks": [2, 40, 7, 3], "kept": [4, 0, 3, 0], "dropped": [0, 4, 1, 0]}


@pytest.mark.parametrize(
    ("plans", "told"),
    [
        (
            {**_FATES, **_ROWS, "seam_jump_m": [0.0, 0.0, 0.00123, 0.0]},
            "9 sent, 3 lost, 1 overtaken, 4 received, 2 refused; 7 waypoints kept, 5 dropped; up to 40 ms old, "
            "seams up to 1.23 mm",
        ),
        # Another writer's, which says something else under that name.
        (7, None),
        (_FATES, None),
    ],
)
def test_info_tells_of_plans_what_it_finds(attempt, tmp_path, plans, told):
    attempt.follow(10)
    write_episode(tmp_path / "of.mcap", attempt.episode("of", {}, [], plans=plans))
    assert told_of_plans(tmp_path / "of.mcap") == ([told] if told else [])
    write_episode(tmp_path / "none.mcap", attempt.episode("none", {}, []))
    assert told_of_plans(tmp_path / "none.mcap") == []


def test_the_target_never_jumps(attempt):
    target = run(attempt, Prodder()).episode("x")["target_pose"]
    step_m = np.linalg.norm(np.diff(target.data[:, :3], axis=0), axis=1)
    # The steepest way runs from the start, at most 60 mm away, to the first waypoint 48 ms later, by a cubic.
    assert step_m.max() < 1.5 * 0.060 / 40
    # Nor does its velocity: within 48 ms it goes from rest to that and back.
    assert np.abs(np.diff(step_m)).max() < 6.0 * 0.060 / 40**2


def test_plans_arrive_late_in_disorder_or_not_at_all_as_the_link_says_and_the_same_every_time(short, peg_model, rig):
    config = DeployConfig(latency_s=0.03, jitter_s=0.04, loss=0.2, control=GENTLE.control)
    episodes = roll_out([3, 4], Prodder(), short, peg_model, rig, config)
    assert roll_out([3, 4], Prodder(), short, peg_model, rig, config) == episodes
    for episode in episodes:
        plans = episode.meta["plans"]
        assert 2 <= plans["lost"] <= 16
        assert plans["sent"] == 40
        assert 0 <= plans["sent"] - plans["lost"] - plans["overtaken"] - plans["received"] <= 4  # Those underway.
        assert min(plans["age_ticks"]) >= 32
        assert len(set(plans["age_ticks"])) > 5
        assert all(len(plans[name]) == plans["received"] for name in ("kept", "dropped", "seam_jump_rad"))
    assert sum(episode.meta["plans"]["refused"].get("reordered", 0) for episode in episodes) > 0
    # What the link draws changes nobody else's numbers: scene, noise and policy are those of a perfect one.
    perfect = roll_out([3], Prodder(), short, peg_model, rig, DeployConfig())[0]
    tare = perfect.events[0]
    for name in ("wrench_raw", "joint_states"):
        ours, theirs = (each[name].data[each[name].t < tare.stop_ns] for each in (episodes[0], perfect))
        np.testing.assert_array_equal(ours, theirs)
    assert perfect.meta["plans"]["lost"] == 0


def test_a_policy_that_falls_silent_is_held_two_and_a_half_periods_and_a_tick_after_its_last_plan(attempt):
    rollout, policy = Rollout(attempt, Prodder(), Link(latency_s=0.02)), Prodder(horizon=16)
    for _ in range(8):
        rollout.plan(policy.act(rollout.look()[None], rollout.goal_pose[None], [attempt.rng])[0])
        rollout.follow()
    while not rollout.over:
        rollout.look()
        rollout.follow()
    governor = rollout.episode("silent")["governor"]
    last_ns = attempt.start_ns + (7 * 50 + 2 + 20) * MS
    held = np.flatnonzero(governor.column("mode") != RUN)
    first = held[governor.t[held] > last_ns][0]
    assert governor.t[first] == last_ns + (125 + 1) * MS
    assert cause_of(int(governor.column("cause")[first])) == "silence"


def test_a_policy_is_asked_again_only_when_its_actions_are_done(short, peg_model, rig):
    policy = Prodder(n_action_steps=4)
    config = DeployConfig(episodes=2, control=GENTLE.control)
    episodes = roll_out(range(2), policy, short, peg_model, rig, config)
    assert len(policy.shown) == 10
    assert all(shown.shape == (2, 2, policy.features.width) for shown in policy.shown)
    assert [episode.meta["policy"]["steps"] for episode in episodes] == [40, 40]


def test_attempts_side_by_side_are_those_that_would_be_alone(short, peg_model, rig):
    config = DeployConfig()
    together = roll_out([4, 9], Prodder(), short, peg_model, rig, config)
    alone = [roll_out([index], Prodder(), short, peg_model, rig, config)[0] for index in (4, 9)]
    assert together == alone
    assert together[0] != together[1]
    assert [episode.meta["seed"] for episode in together] == [[0, 4, EVALUATE], [0, 9, EVALUATE]]


@pytest.mark.parametrize("spoil", [np.nan, np.inf, 1e200])
def test_a_policy_that_puts_out_what_is_no_pose_is_counted_named_and_not_followed(attempt, spoil):
    class Mad(Prodder):
        def act(self, observations, goal_pose, rngs):
            return super().act(observations, goal_pose, rngs) * spoil

    episode = run(attempt, Mad()).episode("mad")
    assert episode.meta["plans"]["refused"] == {"not-finite": 40}
    assert set(episode.meta["plans"]["kept"]) == {0}
    target = episode["target_pose"].data
    np.testing.assert_allclose(target, target[:1].repeat(len(target), axis=0), atol=1e-12)
    assert [event.label for event in episode.events if event.kind == "safety"]


def test_of_a_plan_that_is_longer_than_a_packet_the_first_part_is_sent(attempt):
    policy = Prodder(horizon=MOST_WAYPOINTS + 36)
    plans = run(attempt, policy).episode("long").meta["plans"]
    assert plans["refused"] == {}
    assert set(plans["kept"]) == {MOST_WAYPOINTS}


@pytest.fixture
def untrained() -> LearnedPolicy:
    rng, features = np.random.default_rng(0), Features(WITH_FORCE)
    config = PolicyConfig(mlp=MlpConfig(width=16, layers=1, step_embedding=8), horizon=4)
    observations = rng.normal(size=(50, features.width)).astype(np.float32)
    actions = rng.normal(size=(50, 9)).astype(np.float32) * 0.01
    return LearnedPolicy(
        config,
        features,
        50 * MS,
        fit_observations(observations, features.columns, features.floors),
        fit_actions(actions, ACTION_COLUMNS, ACTION_FLOORS),
    ).eval()


def test_a_policy_without_its_sense_of_force_is_shown_zero_and_the_rest_as_it_is(attempt):
    inner = Prodder()
    rollout = run(attempt, WithoutForceInput(inner))
    width = inner.features.width
    force = np.zeros(width, bool)
    for group in FORCE_GROUPS:
        force[inner.features.columns_of(group)] = True
    assert force.sum() == 12
    shown, seen = np.stack([shown[0, -1] for shown in inner.shown]), np.stack(rollout.seen)
    assert (shown[:, force] == 0.0).all()
    np.testing.assert_array_equal(shown[:, ~force], seen[:, ~force])
    assert np.abs(seen[:, force]).max() > 1.0  # The rollout itself was shown the truth, and keeps it.


def test_zeroed_force_changes_what_a_network_does_only_through_its_input(untrained):
    policy = WithoutForceInput(untrained)
    rng = np.random.default_rng(1)
    observations = rng.normal(size=(3, 2, untrained.features.width)).astype(np.float32)
    kept = observations.copy()
    goals = np.tile([0.5, 0.0, 0.12, 0.0, 1.0, 0.0, 0.0], (3, 1))
    rngs = [[np.random.default_rng(i) for i in range(3)] for _ in range(3)]
    zeroed = policy.act(observations, goals, rngs[0])
    np.testing.assert_array_equal(observations, kept)
    assert not np.array_equal(zeroed, untrained.act(observations, goals, rngs[1]))
    for group in FORCE_GROUPS:
        observations[..., untrained.features.columns_of(group)] = 0.0
    np.testing.assert_array_equal(zeroed, untrained.act(observations, goals, rngs[2]))
    for name in ("features", "period_ns", "n_obs_steps", "horizon", "n_action_steps"):
        assert getattr(policy, name) == getattr(untrained, name)


@pytest.mark.parametrize(
    "change",
    [{"episodes": 0}, {"batch": 0}, {"latency_s": -0.1}, {"jitter_s": -0.1}, {"loss": 1.5}, {"tare_s": float("nan")}],
)
def test_a_deployment_that_makes_no_sense_is_refused(change):
    with pytest.raises(ConfigError, match=f"{next(iter(change))} is"):
        DeployConfig(**change)
