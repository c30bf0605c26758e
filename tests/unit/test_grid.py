"""The grid of steps: where it starts, where it ends, and at which rates."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest

from wrenchflow.datasets.grid import Grid, rate_of
from wrenchflow.datasets.sample import STREAMS, to_steps
from wrenchflow.datasets.split import validation_ids
from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import ConfigError, DatasetError
from wrenchflow.observation import OBSERVATIONS, actions, observe
from wrenchflow.signals import JOINTS, POSE, TWIST, WRENCH

MS = 1_000_000
START_NS = 1_700_000_000_000_000_000
SIGNALS = {"joint_states": JOINTS, "tcp_twist": TWIST, "wrench": WRENCH}


def stream(rng: np.random.Generator, name: str, n: int) -> Stream:
    signal = SIGNALS.get(name, POSE)
    data = rng.normal(size=(n, signal.width))
    if signal is POSE:
        data[:, 3:] /= np.linalg.norm(data[:, 3:], axis=1, keepdims=True)
    return Stream(START_NS + np.arange(n, dtype=np.int64) * MS, data, signal)


@pytest.fixture
def episode() -> Episode:
    """One second at 1 kHz; the tare ends after 200 ms, and the success comes at 900 ms."""
    rng = np.random.default_rng(0)
    streams = {name: stream(rng, name, 1 if name == "goal_pose" else 1000) for name in STREAMS}
    tare = Event(START_NS + 100 * MS, START_NS + 200 * MS, "phase", "tare")
    success = Event(START_NS + 900 * MS, START_NS + 900 * MS, "success")
    return Episode("0007", "peg", streams, (tare, success), {"result": {"success": True}})


def test_steps_run_from_the_tare_to_the_success(episode):
    steps = to_steps(episode, 20)
    np.testing.assert_array_equal(steps.t, START_NS + np.arange(200, 900, 50)[:14] * MS)
    assert steps.t[-1] + steps.period_ns == START_NS + 900 * MS
    assert (steps.episode_id, steps.period_ns, steps.success) == ("0007", 50 * MS, True)
    seen = observe(episode.streams, steps.t)
    assert list(steps.observations) == list(OBSERVATIONS)
    for name, values in steps.observations.items():
        np.testing.assert_array_equal(values, seen[name])
    np.testing.assert_array_equal(steps.actions, actions(episode.streams, steps.t, steps.t + 50 * MS))


def test_without_events_steps_run_while_all_streams_do(episode):
    late = episode["wrench"].between(START_NS + 33 * MS, START_NS + 5000 * MS)
    short = episode["target_pose"].between(0, START_NS + 700 * MS)
    bare = replace(episode, events=()).with_stream("wrench", late).with_stream("target_pose", short)
    steps = to_steps(bare, 100)
    assert steps.t[0] == START_NS + 33 * MS
    assert START_NS + 689 * MS <= steps.t[-1] + steps.period_ns <= START_NS + 699 * MS


@pytest.mark.parametrize("meta", [{}, {"result": {"success": False}}, {"result": "won"}, {"success": True}])
def test_success_is_what_the_result_says(episode, meta):
    assert not to_steps(replace(episode, meta=meta)).success


@pytest.mark.parametrize("rate_hz", [1, 15, 20, 25, 30, 60, 1000, Fraction(30000, 1001), Fraction(60000, 1001)])
def test_the_rate_is_known_from_the_period(rate_hz):
    assert rate_of(Grid(rate_hz=Fraction(rate_hz)).period_ns) == rate_hz


@pytest.mark.parametrize("rate_hz", [0, -20, 1001])
def test_a_rate_that_no_policy_runs_at_is_refused(rate_hz):
    with pytest.raises(ConfigError, match=f"at most 1000 Hz, got {rate_hz} Hz"):
        Grid(rate_hz=Fraction(rate_hz))


def test_an_episode_without_room_for_a_step_is_refused(episode):
    with pytest.raises(DatasetError, match=r"episode 0007: there are 0\.700 s .*, expected a step of 1 s or more"):
        to_steps(episode, 1)


def test_an_unprocessed_episode_is_refused(episode):
    raw = replace(episode, streams={name: s for name, s in episode.streams.items() if name != "wrench"})
    with pytest.raises(
        DatasetError, match=r"0007 has no samples of wrench\. It has: goal_pose, .*process` adds wrench"
    ):
        to_steps(raw)


def test_what_cannot_be_observed_names_the_episode(episode):
    data = episode["wrench"].data.copy()
    data[500] = np.nan
    with pytest.raises(DatasetError, match="episode 0007: 'wrench' is not finite at the step at 1700000000500000000"):
        to_steps(episode.with_stream("wrench", replace(episode["wrench"], data=data)))


def test_the_split_depends_on_the_ids_alone():
    ids = [f"{i:04d}" for i in range(50)]
    valid = validation_ids(ids, 0.1)
    assert len(valid) == 5
    assert valid == validation_ids(ids[::-1], 0.1)
    assert validation_ids(ids, 0.0) == frozenset()
    assert len(validation_ids(ids[:2], 0.01)) == 1
    assert validation_ids(ids[:1], 0.9) == frozenset()
