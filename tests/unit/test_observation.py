"""Observations that cannot be made are refused, in one line that says what, where and what the limit is."""

from dataclasses import replace

import numpy as np
import pytest

from wrenchflow.episode import Stream
from wrenchflow.errors import DatasetError
from wrenchflow.observation import OBSERVATIONS, actions, observe
from wrenchflow.signals import FORCE, JOINTS, POSE, TWIST, WRENCH

MS = 1_000_000


def constant(signal, n=600, period_ns=MS) -> Stream:
    data = np.ones((n, signal.width))
    if signal is POSE:
        data[:, 3:] = (0.0, 1.0, 0.0, 0.0)
    return Stream(np.arange(n, dtype=np.int64) * period_ns, data, signal)


@pytest.fixture
def streams() -> dict[str, Stream]:
    return {
        "tcp_pose": constant(POSE),
        "tcp_twist": constant(TWIST),
        "joint_states": constant(JOINTS),
        "wrench": constant(WRENCH),
        "goal_pose": constant(POSE, 1),
        "target_pose": constant(POSE),
    }


def without(stream: Stream, start: int, stop: int) -> Stream:
    keep = np.ones(len(stream), bool)
    keep[start:stop] = False
    return replace(stream, t=stream.t[keep].copy(), data=stream.data[keep].copy())


AT = np.array([300 * MS])
USERS = {
    "tcp_pose": ["tcp_pose"],
    "tcp_twist": ["tcp_twist"],
    "joint_states": ["joint_position", "joint_velocity"],
    "wrench": ["wrench", "wrench_mean", "wrench_window"],
}


@pytest.mark.parametrize(("stream", "name"), [(stream, name) for stream, names in USERS.items() for name in names])
def test_a_gap_is_refused_with_its_stream_time_length_and_limit(streams, stream, name):
    streams[stream] = without(streams[stream], 290, 315)
    with pytest.raises(DatasetError) as caught:
        observe(streams, np.array([313 * MS]), [name])
    message = str(caught.value)
    assert f"'{stream}'" in message
    assert "289000000 ns" in message
    assert "313000000 ns" in message
    assert "the limit is 20 ms" in message


@pytest.mark.parametrize("name", ["wrench_mean", "wrench_window"])
@pytest.mark.parametrize("missing", [(255, 280), (195, 225), (230, 300)])
def test_a_gap_anywhere_in_a_window_is_refused(streams, name, missing):
    streams["wrench"] = without(streams["wrench"], *missing)
    if name == "wrench_window" and missing == (195, 225):
        assert np.isfinite(observe(streams, AT, [name])[name]).all()  # Before the window: none of its business.
    else:
        with pytest.raises(DatasetError, match=r"has no sample for \d+\.0 ms"):
            observe(streams, AT, [name])


def test_lost_ticks_within_the_limit_are_bridged(streams):
    for name in USERS:
        streams[name] = without(streams[name], 290, 309)
    assert all(np.isfinite(value).all() for value in observe(streams, AT).values())


def test_a_force_that_stopped_coming_is_not_held(streams):
    streams["wrench"] = streams["wrench"].between(0, 280 * MS)
    assert len(observe(streams, AT - 2 * MS, ["wrench"])["wrench"]) == 1
    with pytest.raises(DatasetError, match=r"no sample for 21.0 ms after 279000000 ns"):
        observe(streams, AT, ["wrench"])


@pytest.mark.parametrize("stream", ["tcp_pose", "tcp_twist", "joint_states"])
def test_nothing_is_extrapolated(streams, stream):
    streams[stream] = streams[stream].between(100 * MS, 300 * MS)
    with pytest.raises(DatasetError, match=f"'{stream}' ends at 299000000 ns, before the step at 300000000 ns"):
        observe(streams, AT, USERS[stream])
    with pytest.raises(DatasetError, match=f"'{stream}' starts at 100000000 ns, after the step at 99000000 ns"):
        observe(streams, np.array([99 * MS]), USERS[stream])


def test_a_goal_that_has_not_been_said_is_refused(streams):
    streams["goal_pose"] = replace(streams["goal_pose"], t=AT + 1)
    with pytest.raises(DatasetError, match="'goal_pose' starts at 300000001 ns"):
        observe(streams, AT, ["goal_pose"])


def test_a_sensor_too_slow_for_the_window_is_refused(streams):
    streams["wrench"] = constant(WRENCH, 60, 10 * MS)
    with pytest.raises(DatasetError, match="'wrench' has 15 samples in the 150 ms up to the step at 300000000 ns"):
        observe(streams, AT, ["wrench_window"])


@pytest.mark.parametrize("name", list(OBSERVATIONS))
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_what_is_not_finite_in_single_precision_is_refused(streams, name, value):
    for stream, values in streams.items():
        data = values.data.copy()
        data[min(300, len(data) - 1)] = value
        streams[stream] = replace(values, data=data)
    with pytest.raises(DatasetError, match="at 300000000 ns"):
        observe(streams, AT, [name])
    with pytest.raises(DatasetError, match="'target_pose'"):
        actions(streams, AT, AT)


def test_a_quaternion_that_is_no_rotation_is_refused(streams):
    data = streams["tcp_pose"].data.copy()
    data[301, 3:] = 0.0
    streams["tcp_pose"] = replace(streams["tcp_pose"], data=data)
    assert len(observe(streams, AT, ["tcp_pose"])["tcp_pose"]) == 1
    with pytest.raises(DatasetError, match="expected finite numbers and a unit quaternion, got 1 1 1 0 0 0 0"):
        observe(streams, AT + 1, ["tcp_pose"])


def test_a_force_without_moments_is_no_wrench(streams):
    streams["wrench"] = constant(FORCE)
    with pytest.raises(DatasetError, match="'wrench' has columns fx fy fz, expected fx fy fz tx ty tz"):
        observe(streams, AT)


def test_missing_and_unknown_names_say_what_there_is(streams):
    del streams["wrench"]
    with pytest.raises(DatasetError, match=r"'wrench' is missing. There is: goal_pose, joint_states, target_pose"):
        observe(streams, AT)
    with pytest.raises(DatasetError, match=r"unknown observation 'wrenches'. Did you mean 'wrench'"):
        observe(streams, AT, ["wrenches"])
    streams["tcp_pose"] = streams["tcp_pose"].between(0, 0)
    with pytest.raises(DatasetError, match="'tcp_pose' has no samples"):
        observe(streams, AT, ["tcp_pose"])


def test_a_target_that_is_not_there_yet_is_no_action(streams):
    with pytest.raises(DatasetError, match="'target_pose' ends at 599000000 ns, before the action at 600000000 ns"):
        actions(streams, np.array([550 * MS]), np.array([600 * MS]))
    streams["target_pose"] = without(streams["target_pose"], 330, 360)
    with pytest.raises(DatasetError, match=r"'target_pose' has no sample for 21.0 ms after 329000000 ns"):
        actions(streams, AT, AT + 50 * MS)
