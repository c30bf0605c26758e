"""Demonstrations: the scripted operator succeeds by feel, every stream is there, and a seed is every bit."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.devices.device import Reading
from wrenchflow.collect.folder import collect_folder
from wrenchflow.collect.follow import Follower
from wrenchflow.collect.operators_table import require_operator
from wrenchflow.collect.session import Session, _starts_of, demonstrate
from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.control.controller import Controller
from wrenchflow.errors import CalibrationError, ConfigError, OutputError
from wrenchflow.manifest import read_manifest
from wrenchflow.recording.reader import read_episode
from wrenchflow.rig import load_rig
from wrenchflow.sim.attempt import Attempt, episode_id
from wrenchflow.sim.config import AttemptConfig
from wrenchflow.spatial import IDENTITY_POSE, compose, exp_so3, inverse, make_pose, rotation_of

CONFIG = CollectConfig(seed=11)
KILOHERTZ = {
    "joint_states",
    "joint_command",
    "external_torque",
    "tcp_pose",
    "tcp_twist",
    "wrench_raw",
    "target_pose",
    "command_pose",
    "impedance",
    "request",
    "governor",
}


@pytest.fixture(scope="module")
def episodes(unchecked):
    first = demonstrate(0, CONFIG)  # Shapes are checked once.
    with unchecked():
        return [first, *(demonstrate(index, CONFIG) for index in range(1, 6))]


def test_the_operator_inserts_by_feel_and_is_gentle(episodes):
    for episode in episodes:
        result = episode.meta["result"]
        assert result["success"], (episode.id, result)
        assert result["duration_s"] < 8.0
        assert [event.kind for event in episode.events if event.kind in ("success", "failure")] == ["success"]
        force = np.linalg.norm(episode["wrench_raw"].data[:, :3], axis=1)
        assert force.max() < 40.0


def test_every_stream_of_the_topic_table_is_there_at_its_rate(episodes):
    for episode in episodes:
        assert set(episode.streams) == KILOHERTZ | {"teleop/joy", "teleop/twist", "goal_pose"}
        for name in KILOHERTZ:
            assert np.diff(episode[name].t).tolist() == [1_000_000] * (len(episode[name]) - 1), name
        for name in ("teleop/joy", "teleop/twist"):
            assert set(np.diff(episode[name].t)) == {5_000_000}
        assert len(episode["goal_pose"]) == 1
        assert np.isnan(episode["request"].column("gripper")).all()  # This rig has none, and nobody asks for one.
        for name, stream in episode.streams.items():
            asked = stream.data[:, :-1] if name == "request" else stream.data
            assert np.isfinite(asked).all(), name


def test_phases_follow_each_other_from_tare_to_insertion(episodes):
    for episode in episodes:
        phases = episode.events_of("phase")
        assert [phases[0].label, phases[1].label, phases[-1].label] == ["tare", "approach", "insert"]
        assert all(a.stop_ns <= b.start_ns for a, b in itertools.pairwise(phases))
        tare = phases[0]
        at_rest = episode["joint_states"].between(tare.start_ns, tare.stop_ns).data[:, 7:14]
        assert np.abs(at_rest.mean(0)).max() < 1e-3


def test_a_phase_that_comes_back_at_once_was_never_left():
    for phases, starts in (
        ("aaaa", [0]),
        ("aabb", [0, 2]),
        ("aaabaaa", [0]),
        ("aaabbbaaa", [0, 3, 6]),  # Too long for noise.
        ("aaabcccc", [0, 3, 4]),  # Short, but on the way to somewhere else.
        ("aaababab", [0, 7]),  # What is last is not known to come back.
        ("abaaa", [0]),
    ):
        assert _starts_of(np.array([ord(each) for each in phases]), 2) == starts, phases


def test_what_is_perceived_is_not_what_is_true(episodes):
    errors = []
    for episode in episodes:
        true = np.array(episode.meta["simulator"]["T_base_goal"])
        errors.append(episode["goal_pose"].data[0] - true)
    errors = np.array(errors)
    assert np.linalg.norm(errors[:, :2], axis=1).min() > 1e-5
    assert np.abs(errors[:, :2]).max() < 0.01
    assert (errors[:, 2:] == 0.0).all()
    # The peg ends in the true hole, not in the perceived one.
    for episode in episodes:
        tip = compose(inverse(np.array(episode.meta["simulator"]["T_base_goal"])), episode["tcp_pose"].data[-1])
        assert np.hypot(*tip[:2]) < 0.001
        assert tip[2] > 0.019


def test_the_recorded_target_is_what_the_device_asked_for_and_nothing_else(episodes):
    episode = episodes[0]
    twists, target = episode["teleop/twist"], episode["target_pose"]
    first = int(np.searchsorted(target.t, twists.t[0]))
    pose = target.data[first - 1]
    for k, twist in enumerate(twists.data):
        pose = make_pose(pose[:3] + 0.005 * twist[:3], exp_so3(0.005 * twist[3:]) @ rotation_of(pose[3:]))
        after = target.data[first + 5 * k + 4]
        np.testing.assert_allclose(after[:3], pose[:3], atol=1e-12)
        np.testing.assert_allclose(rotation_of(after[3:]), rotation_of(pose[3:]), atol=1e-12)


def test_the_tracked_reference_is_disturbed_and_the_target_is_not(episodes, unchecked):
    with unchecked():
        clean = demonstrate(0, replace(CONFIG, disturbance_m=0.0))
    for episode, disturbed in ((episodes[0], True), (clean, False)):
        start = episode.events_of("phase")[1].start_ns
        window = slice(*np.searchsorted(episode["target_pose"].t, [start + 200_000_000, start + 500_000_000]))
        apart = episode["command_pose"].data[window, :3] - episode["target_pose"].data[window, :3]
        assert (np.abs(apart).max() > 1e-4) == disturbed


def test_axes_are_whole_counts_and_say_what_the_twist_says(episodes):
    joy, twist = episodes[0]["teleop/joy"], episodes[0]["teleop/twist"]
    np.testing.assert_array_equal(joy.data, np.rint(joy.data))
    assert np.abs(joy.data[:, :6]).max() <= 350
    np.testing.assert_array_equal(joy.t, twist.t)
    follower = Follower(CONFIG.twist_map, Impedance(), IDENTITY_POSE, full_scale_counts=350, ticks=5)
    controller = Controller(load_rig("panda_peg"), ControlConfig())
    for t_ns, counts, expected in zip(joy.t.tolist(), joy.data[:, :6].astype(np.int64), twist.data, strict=True):
        follower.take(Reading(t_ns=t_ns, counts=counts))
        follower.move(t_ns, controller)
        np.testing.assert_array_equal(follower.twist, expected)


def test_an_index_is_every_bit_of_an_episode(episodes, unchecked):
    with unchecked():
        assert demonstrate(1, CONFIG) == episodes[1]
        assert demonstrate(1, replace(CONFIG, seed=12)) != episodes[1]
    assert len({episode["tcp_pose"].data[0].tobytes() for episode in episodes}) == len(episodes)


def test_names_come_from_what_determines_an_episode():
    every = itertools.product(("a", "b"), (0, 1), (0, 1), ("", "emulated", "keyboard"))
    names = {episode_id(*one) for one in every}
    assert len(names) == 24
    assert episode_id("peg-insertion", 0, 3).startswith("peg-insertion-")
    assert episode_id("peg-insertion", 0, 3).endswith("-0003")


def test_two_operators_meet_the_same_scenes_under_names_of_their_own(unchecked):
    operators = ("scripted", "emulated", "blind-spiral")
    with unchecked():
        tried = [demonstrate(0, replace(CONFIG, operator=operator, time_limit_s=0.05)) for operator in operators]
    assert len({episode.id for episode in tried}) == 3
    assert all(episode.meta["simulator"] == tried[0].meta["simulator"] for episode in tried)


def test_a_folder_holds_the_episodes_and_what_made_them(tmp_path, episodes, unchecked):
    out, again, config = tmp_path / "raw", tmp_path / "again", replace(CONFIG, episodes=2)
    with unchecked():
        demonstrations = list(collect_folder(out, config))
        list(collect_folder(again, config))
    names = sorted([*(f"{one.id}.mcap" for one in demonstrations), "manifest.json"])
    assert sorted(path.name for path in out.iterdir()) == names
    assert [one.samples for one in demonstrations] == [len(episode["tcp_pose"]) for episode in episodes[:2]]
    assert read_manifest(out)["seed"] == 11
    episode = read_episode(out / f"{demonstrations[1].id}.mcap")
    assert episode.streams == episodes[1].streams
    assert episode.events == episodes[1].events
    for name in names:
        assert (again / name).read_bytes() == (out / name).read_bytes(), name
    with pytest.raises(OutputError, match="exists already"):
        list(collect_folder(out, config))


def test_names_that_do_not_exist_are_refused_before_anything_is_written(tmp_path):
    for config in (
        replace(CONFIG, task="peg-inserton"),
        replace(CONFIG, operator="scriptd"),
        replace(CONFIG, rig="pandapeg"),
    ):
        with pytest.raises(ConfigError, match="Did you mean"):
            list(collect_folder(tmp_path / "raw", config))
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(ConfigError, match=r"^unknown operator 'nobody'\. Available: "):
        require_operator(replace(CONFIG, operator="nobody"))


def test_a_tool_that_is_touched_during_the_tare_is_not_tared(peg, peg_model, rig):
    attempt = Attempt(peg, peg_model, rig, AttemptConfig(), seed=(0, 0))
    attempt.plant.rows["wrench_raw"][700:, 2] += 8.0
    with pytest.raises(CalibrationError):
        Session(attempt, CONFIG)


def test_an_attempt_ends_at_its_time_limit_with_the_name_of_its_failure(peg, peg_model, rig):
    attempt = Attempt(peg, peg_model, rig, AttemptConfig(tare_s=0.5), seed=(0, 1))
    assert not attempt.over
    assert attempt.elapsed_s == pytest.approx(0.001)  # The tick whose force came after the tare.
    while not attempt.over:
        attempt.follow(200)
    assert attempt.elapsed_s == pytest.approx(8.001)
    outcome = attempt.outcome
    assert (outcome.success, outcome.failure, outcome.progress) == (False, "timeout", 0.0)
    episode = attempt.episode("x", {}, [])
    assert episode.events[-1].kind == "failure"
    assert episode.events[-1].label == "timeout"
    stamps, wrench, quats = attempt.samples_since(attempt.plant.count - 5)
    np.testing.assert_array_equal(stamps, episode["wrench_raw"].t[-5:])
    np.testing.assert_array_equal(wrench, episode["wrench_raw"].data[-5:])
    np.testing.assert_array_equal(quats, episode["tcp_pose"].data[-6:-1, 3:])
