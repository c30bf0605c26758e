"""Rerun's own MCAP reader, without any of our code, decodes our files to the values that we read from them."""

import json

import numpy as np
import pytest

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.recording.images import image_messages, images_of, jpeg
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode
from wrenchflow.signals import IMPEDANCE, JOINT_TORQUE, JOINTS, JOY, POSE, WRENCH

N = 700
T = 1_700_000_000_000_000_000 + np.arange(N, dtype=np.int64) * 1_000_003


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    rng = np.random.default_rng(4)
    kinds = {"wrench": WRENCH, "tcp_pose": POSE, "joint_states": JOINTS, "joint_command": JOINT_TORQUE}
    kinds |= {"impedance": IMPEDANCE}
    streams = {name: Stream(T, rng.normal(size=(N, kind.width)), kind, "base") for name, kind in kinds.items()}
    joy = np.hstack((rng.integers(-350, 350, (N, 6)), rng.integers(0, 2, (N, 2)))).astype(float)
    streams["teleop/joy"] = Stream(T, joy, JOY, "device")
    pictures = [jpeg(rng.integers(0, 256, (24, 32, 3), np.uint8)) for _ in range(20)]
    messages = {"camera/wrist": image_messages(T[::35], pictures, "camera/wrist")}
    at = tmp_path_factory.mktemp("rerun") / "0007.mcap"
    event = Event(int(T[10]), int(T[90]), "contact", "rim")
    write_episode(at, Episode("0007", "peg-insertion", streams, (event,), {"seed": 7}, messages))
    return at


@pytest.fixture(scope="module")
def decoded(path, rerun_columns):
    return rerun_columns(path, "ros2_timestamp")


@pytest.fixture(scope="module")
def episode(path):
    return read_episode(path)


def test_a_wrench_is_the_same(decoded, episode):
    t, rows = decoded["/wrench", "geometry_msgs.msg.WrenchStamped:message"]
    parts = [(row[0]["wrench"]["force"], row[0]["wrench"]["torque"]) for row in rows]
    data = [[part[axis] for part in both for axis in "xyz"] for both in parts]
    assert Stream(t, np.array(data), WRENCH, rows[0][0]["header"]["frame_id"]) == episode["wrench"]


def test_a_pose_is_the_same_in_single_precision(decoded, episode):
    t, positions = decoded["/tcp_pose", "InstancePoses3D:translations"]
    quat_xyzw = np.array(decoded["/tcp_pose", "InstancePoses3D:quaternions"][1])[:, 0]
    pose = episode["tcp_pose"]
    np.testing.assert_array_equal(t, pose.t)
    np.testing.assert_array_equal(np.array(positions)[:, 0], pose.data[:, :3].astype(np.float32))
    np.testing.assert_array_equal(quat_xyzw, pose.data[:, [4, 5, 6, 3]].astype(np.float32))


@pytest.mark.parametrize("name", ["joint_states", "joint_command"])
def test_joints_are_the_same(decoded, episode, name):
    stream = episode[name]
    parts = ("position", "velocity", "effort") if name == "joint_states" else ("effort",)
    for k, part in enumerate(parts):
        t, rows = decoded[f"/{name}/{part}", "Scalars:scalars"]
        np.testing.assert_array_equal(t, stream.t)
        np.testing.assert_array_equal(np.array(rows), stream.data[:, 7 * k : 7 * k + 7])
    assert decoded[f"/{name}/effort", "SeriesLines:names"][1][0] == [f"panda_joint{k + 1}" for k in range(7)]


def test_the_device_and_the_impedance_are_the_same(decoded, episode):
    axes, buttons = (np.array(decoded[f"/teleop/joy/{part}", "Scalars:scalars"][1]) for part in ("axes", "buttons"))
    np.testing.assert_array_equal(np.hstack((axes, buttons)), episode["teleop/joy"].data)
    np.testing.assert_array_equal(np.array(decoded["/impedance", "Scalars:scalars"][1]), episode["impedance"].data)


def test_images_are_the_same_bytes(decoded, episode):
    t, blobs = decoded["/camera/wrist", "EncodedImage:blob"]
    messages = episode.messages["camera/wrist"]
    np.testing.assert_array_equal(t, messages.t)
    assert [bytes(blob[0]) for blob in blobs] == [bytes(image.data) for image in images_of(messages)]


def test_events_are_the_same(decoded, episode):
    (text,) = decoded["/events", "TextDocument:text"][1][0]
    assert Event(**json.loads(text)) == episode.events[0]
