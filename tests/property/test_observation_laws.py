"""What a policy sees is the same from a recording and from a running robot, and never comes from the future."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wrenchflow import observation
from wrenchflow.episode import Stream
from wrenchflow.observation import HISTORY_NS, OBSERVATIONS, observe
from wrenchflow.signals import JOINTS, POSE, TWIST, WRENCH
from wrenchflow.spatial import rotation_of

EPOCH_NS = 1_700_000_000_000_000_000


def stamps(rng: np.random.Generator, rate_hz: float, jitter: float, duration_s: float) -> np.ndarray:
    period_ns = 1e9 / rate_hz
    late_ns = rng.uniform(0.0, jitter, int(duration_s * rate_hz)) * period_ns
    return EPOCH_NS + (np.arange(len(late_ns)) * period_ns + late_ns).astype(np.int64)


def poses(rng: np.random.Generator, n: int) -> np.ndarray:
    """A tool that points down and wobbles, with quaternions of either sign."""
    quat = (
        np.array([0.0, 1.0, 0.0, 0.0]) + 0.2 * rng.normal(size=(n, 4)).cumsum(0) / np.sqrt(np.arange(1, n + 1))[:, None]
    )
    quat *= rng.choice([-1.0, 1.0], (n, 1)) / np.linalg.norm(quat, axis=1, keepdims=True)
    return np.hstack([rng.normal(size=(n, 3)), quat])


def robot(rng: np.random.Generator, rate_hz: float = 1000.0, wrench_hz: float = 1000.0, jitter: float = 0.0):
    t, t_joints, t_wrench = (stamps(rng, r, jitter, 0.6) for r in (rate_hz, rate_hz, wrench_hz))
    t_goal = EPOCH_NS + np.array([0, 250_000_007], np.int64)
    return {
        "tcp_pose": Stream(t, poses(rng, len(t)), POSE, "base"),
        "tcp_twist": Stream(t, rng.normal(size=(len(t), 6)), TWIST, "base"),
        "joint_states": Stream(t_joints, rng.normal(size=(len(t_joints), 21)), JOINTS),
        "wrench": Stream(t_wrench, rng.normal(size=(len(t_wrench), 6)), WRENCH, "base"),
        "goal_pose": Stream(t_goal, poses(rng, 2), POSE, "base"),
    }


def tail(stream: Stream, t_ns: int, seen_until_ns: int, rows_more: int) -> Stream:
    """What a running robot still has of a stream: back to the last sample at or before the reach, or a bit more."""
    first = max(int(np.searchsorted(stream.t, t_ns - HISTORY_NS, side="right")) - 1 - rows_more, 0)
    last = int(np.searchsorted(stream.t, seen_until_ns, side="right"))
    return replace(stream, t=stream.t[first:last].copy(), data=stream.data[first:last].copy())


@given(
    seed=st.integers(0, 2**32 - 1),
    rate_hz=st.sampled_from([150.0, 500.0, 999.0, 1000.0]),
    wrench_hz=st.sampled_from([400.0, 777.0, 1000.0, 2000.0]),
    jitter=st.sampled_from([0.0, 0.3, 0.9]),
    rows_more=st.integers(0, 40),
)
def test_the_tail_of_a_running_robot_gives_the_bits_of_the_whole_recording(seed, rate_hz, wrench_hz, jitter, rows_more):
    rng = np.random.default_rng(seed)
    streams = robot(rng, rate_hz, wrench_hz, jitter)
    period_ns = int(rng.integers(20_000_000, 70_000_000))
    t = np.arange(EPOCH_NS + 10_000_000, EPOCH_NS + 560_000_000, period_ns)
    offline = observe(streams, t)
    for k, t_ns in enumerate(t):
        # A little after the step, so that the sample that follows it has come in.
        live = {name: tail(s, int(t_ns), int(t_ns) + 14_000_000, rows_more) for name, s in streams.items()}
        live["goal_pose"] = streams["goal_pose"].between(0, int(t_ns) + 1)
        seen = observe(live, t[k : k + 1])
        for name in OBSERVATIONS:
            assert seen[name].tobytes() == offline[name][k].tobytes(), name


@given(seed=st.integers(0, 2**32 - 1), step=st.integers(100, 599))
def test_on_a_stamp_the_sample_itself_is_seen(seed, step):
    streams = robot(np.random.default_rng(seed))
    seen = observe(streams, streams["tcp_pose"].t[step : step + 1])
    pose = streams["tcp_pose"].data[step]
    sign = np.sign(pose[4])
    np.testing.assert_array_equal(seen["tcp_pose"][0, :3], pose[:3].astype(np.float32))
    np.testing.assert_array_equal(seen["tcp_pose"][0, 3:], (sign * pose[3:]).astype(np.float32))
    joints = streams["joint_states"].data[step].astype(np.float32)
    for name, expected in (
        ("tcp_twist", streams["tcp_twist"].data[step].astype(np.float32)),
        ("joint_position", joints[:7]),
        ("joint_velocity", joints[7:14]),
        ("wrench", streams["wrench"].data[step].astype(np.float32)),
        ("wrench_window", streams["wrench"].data[step - 49 : step + 1].astype(np.float32)),
    ):
        assert seen[name][0].tobytes() == expected.tobytes(), name
    mean = streams["wrench"].data[step - 99 : step + 1].mean(axis=0)
    np.testing.assert_allclose(seen["wrench_mean"][0], mean, rtol=1e-5, atol=1e-6)


@given(seed=st.integers(0, 2**32 - 1), later=st.floats(-1e3, 1e3))
def test_force_that_is_yet_to_come_is_never_seen(seed, later):
    rng = np.random.default_rng(seed)
    streams = robot(rng, jitter=0.5)
    t = np.array([EPOCH_NS + 300_000_000])
    future = streams["wrench"].data.copy()
    future[streams["wrench"].t > t[0]] = later
    changed = {**streams, "wrench": replace(streams["wrench"], data=future)}
    for name in ("wrench", "wrench_mean", "wrench_window"):
        assert observe(streams, t)[name].tobytes() == observe(changed, t)[name].tobytes()


@given(seed=st.integers(0, 2**32 - 1))
def test_the_signs_of_recorded_quaternions_do_not_matter(seed):
    rng = np.random.default_rng(seed)
    streams = robot(rng, jitter=0.4)
    t = np.arange(EPOCH_NS + 100_000_000, EPOCH_NS + 500_000_000, 33_333_333)
    flipped = dict(streams)
    for name in ("tcp_pose", "goal_pose"):
        data = streams[name].data.copy()
        data[:, 3:] *= rng.choice([-1.0, 1.0], (len(data), 1))
        flipped[name] = replace(streams[name], data=data)
    for name in ("tcp_pose", "goal_pose"):
        np.testing.assert_allclose(observe(streams, t)[name], observe(flipped, t)[name], atol=1e-6)


@given(tilt=st.floats(-2.0, 2.0), yaw=st.floats(-3.0, 3.0))
def test_near_a_tool_that_points_down_the_quaternion_never_flips(tilt, yaw):
    rng = np.random.default_rng(0)
    streams = robot(rng)
    down = np.array([0.0, np.cos(yaw / 2), np.sin(yaw / 2), 0.0])  # Straight down, turned about the vertical.
    small = 1e-3 * tilt
    quat = np.stack([down + [small, 0, 0, small], down - [small, 0, 0, small], -down])
    quat /= np.linalg.norm(quat, axis=1, keepdims=True)
    t = EPOCH_NS + np.arange(3, dtype=np.int64)
    streams["tcp_pose"] = Stream(t, np.hstack([np.zeros((3, 3)), quat]), POSE)
    seen = observe(streams, t, ["tcp_pose"])["tcp_pose"][:, 3:]
    assert np.abs(np.diff(seen, axis=0)).max() < 0.02


@given(seed=st.integers(0, 2**32 - 1), period_ms=st.integers(5, 100))
def test_an_action_is_the_target_at_the_next_step(seed, period_ms):
    rng = np.random.default_rng(seed)
    target = robot(rng)["tcp_pose"]
    t = target.t[[50, 200, 400]]
    action = observation.actions({"target_pose": target}, t, t + period_ms * 1_000_000)
    expected = target.data[np.array([50, 200, 400]) + period_ms]
    R = rotation_of(expected[:, 3:])
    np.testing.assert_array_equal(action[:, :3], expected[:, :3].astype(np.float32))
    np.testing.assert_allclose(action[:, 3:6], R[:, :, 0], atol=1e-6)
    np.testing.assert_allclose(action[:, 6:], R[:, :, 1], atol=1e-6)


def test_the_window_of_a_stream_that_has_just_started_is_filled_with_its_first_sample():
    streams = robot(np.random.default_rng(3))
    seen = observe(streams, streams["wrench"].t[9:10], ["wrench_window", "wrench_mean"])
    rows = streams["wrench"].data[:10].astype(np.float32)
    np.testing.assert_array_equal(seen["wrench_window"][0, -10:], rows)
    np.testing.assert_array_equal(seen["wrench_window"][0, :-10], np.repeat(rows[:1], 40, axis=0))
    np.testing.assert_allclose(seen["wrench_mean"][0], streams["wrench"].data[:10].mean(0), rtol=1e-5)


@pytest.mark.parametrize("names", [{"wrench", "goal_pose", "tcp_pose"}, ["goal_pose", "tcp_pose", "wrench"]])
def test_observations_come_in_one_order(names):
    streams = robot(np.random.default_rng(4))
    assert list(observe(streams, streams["tcp_pose"].t[200:201], names)) == ["tcp_pose", "wrench", "goal_pose"]


@given(seed=st.integers(0, 2**32 - 1), weight=st.floats(0.0, 1.0))
def test_between_samples_the_value_lies_on_the_line_and_on_the_great_circle(seed, weight):
    streams = robot(np.random.default_rng(seed))
    t = streams["tcp_pose"].t[200:202]
    at = t[:1] + round(weight * 1_000_000)
    weight = float(at[0] - t[0]) / 1e6
    seen = observe(streams, at)
    for name, stream, columns in (
        ("tcp_pose", "tcp_pose", slice(0, 3)),
        ("tcp_twist", "tcp_twist", slice(0, 6)),
        ("joint_position", "joint_states", slice(0, 7)),
        ("joint_velocity", "joint_states", slice(7, 14)),
    ):
        start, stop = streams[stream].data[200:202, columns]
        np.testing.assert_allclose(
            seen[name][0, : len(start)], (1 - weight) * start + weight * stop, rtol=1e-5, atol=1e-5
        )
    start, stop = (Rotation.from_quat(pose[3:], scalar_first=True) for pose in streams["tcp_pose"].data[200:202])
    between = Rotation.from_quat(seen["tcp_pose"][0, 3:], scalar_first=True)
    angle = (start.inv() * stop).magnitude()
    np.testing.assert_allclose((start.inv() * between).magnitude(), weight * angle, atol=1e-5)
    np.testing.assert_allclose((between.inv() * stop).magnitude(), (1 - weight) * angle, atol=1e-5)
