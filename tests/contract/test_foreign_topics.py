"""Topics of others are imported to the values that were written: an MCAP of mcap-ros2-support, a bag of rosbags."""

from pathlib import Path

import numpy as np
import pytest
from mcap_ros2.writer import Writer as Ros2Writer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from wrenchflow.errors import WrenchflowError
from wrenchflow.imports.import_folder import import_folder
from wrenchflow.imports.units import UNITS
from wrenchflow.recording import codec, schemas
from wrenchflow.recording.reader import read_episode

N = 50
T = 1_700_000_000_000_000_000 + np.arange(N, dtype=np.int64) * 1_000_000
LATER_NS = 250_000
_RNG = np.random.default_rng(4)
WRENCHES = _RNG.normal(size=(N, 6))
POSES = _RNG.normal(size=(N, 7))
JOINTS = _RNG.normal(size=(N, 12))
TOPICS = {
    "/ft/data": "geometry_msgs/msg/WrenchStamped",
    "/pose": "geometry_msgs/msg/PoseStamped",
    "/arm": "sensor_msgs/msg/JointState",
    "/log": "std_msgs/msg/String",
}
MAPPING = """task = "press"
clock = { topic_time = "header" }
[streams.wrench_raw]
topic = "/ft/data"
frame = "sensor"
sign = "robot-on-environment"
[streams.tcp_pose]
topic = "/pose"
[streams.joint_states]
topic = "/arm"
"""


def content(topic: str, i: int, stamp_ns: int) -> dict:
    seconds, nanoseconds = divmod(stamp_ns, 10**9)
    header = {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": "ft_link"}
    wrench, pose, joints = WRENCHES[i].tolist(), POSES[i].tolist(), JOINTS[i].tolist()
    if topic == "/ft/data":
        parts = {"force": wrench[:3], "torque": wrench[3:]}
        return {"header": header, "wrench": {k: dict(zip("xyz", v, strict=True)) for k, v in parts.items()}}
    if topic == "/pose":
        place, turn = dict(zip("xyz", pose[:3], strict=True)), dict(zip("wxyz", pose[3:], strict=True))
        return {"header": header, "pose": {"position": place, "orientation": turn}}
    if topic == "/log":
        return {"data": "hello"}
    names = ["a", "b", "c", "d"]
    return {"header": header, "name": names, "position": joints[:4], "velocity": joints[4:8], "effort": joints[8:]}


def write_mcap(folder: Path, stamps: list[int]) -> Path:
    path = folder / "theirs.mcap"
    with path.open("wb") as file:
        writer = Ros2Writer(file)
        for topic, message in TOPICS.items():
            schema = writer.register_msgdef(message, schemas.definition(message))
            for i, stamp_ns in enumerate(stamps):
                at = int(T[i]) + LATER_NS
                writer.write_message(topic, schema, content(topic, i, stamp_ns), log_time=at, publish_time=at)
        writer.finish()
    return path


def write_bag(folder: Path, stamps: list[int], plugin: StoragePlugin) -> Path:
    store, path = get_typestore(Stores.ROS2_HUMBLE), folder / "bag"
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        for topic, message in TOPICS.items():
            connection = writer.add_connection(topic, message, typestore=store)
            for i, stamp_ns in enumerate(stamps):
                made = store.deserialize_cdr(codec.encode(message, content(topic, i, stamp_ns)), message)
                writer.write(connection, int(T[i]) + LATER_NS, store.serialize_cdr(made, message))
    return path


WRITERS = {
    "mcap": write_mcap,
    "sqlite3 bag": lambda folder, stamps: write_bag(folder, stamps, StoragePlugin.SQLITE3),
    "mcap bag": lambda folder, stamps: write_bag(folder, stamps, StoragePlugin.MCAP),
}


def imported(folder: Path, kind: str, mapping: str = MAPPING, stamps: list[int] | None = None):
    (folder / "topics.toml").write_text(mapping)
    path = WRITERS[kind](folder, stamps or T.tolist())
    ((done,),) = import_folder(folder / "topics.toml", folder / "out", [path])
    return read_episode(folder / "out" / f"{done.id}.mcap")


@pytest.mark.parametrize("kind", WRITERS)
def test_topics_come_with_their_values_stamps_and_frames(tmp_path, kind):
    episode = imported(tmp_path, kind)
    for name, data in {"wrench_raw": WRENCHES, "tcp_pose": POSES, "joint_states": JOINTS}.items():
        np.testing.assert_array_equal(episode[name].data, data)
        np.testing.assert_array_equal(episode[name].t, T)
    assert (episode["wrench_raw"].frame, episode["tcp_pose"].frame) == ("sensor", "ft_link")
    notes = episode.meta["import"]["notes"]
    assert any("says that its frame is 'ft_link'" in note and "'sensor'" in note for note in notes)


@pytest.mark.parametrize("kind", WRITERS)
def test_units_sign_and_clock_are_as_the_mapping_says(tmp_path, kind):
    said = MAPPING.replace('"header"', '"log"').replace("robot-on-environment", "environment-on-robot")
    episode = imported(tmp_path, kind, said.replace('"/ft/data"\n', '"/ft/data"\nforce = { unit = "lbf" }\n'))
    wrench = episode["wrench_raw"]
    np.testing.assert_allclose(wrench.data[:, :3], -WRENCHES[:, :3] * UNITS["N"]["lbf"], rtol=1e-15)
    np.testing.assert_array_equal(wrench.data[:, 3:], -WRENCHES[:, 3:])
    np.testing.assert_array_equal(wrench.t, T + LATER_NS)


@pytest.mark.parametrize("kind", WRITERS)
def test_stamps_that_repeat_or_go_back_are_refused_or_dropped_and_counted(tmp_path, kind):
    stamps = T.tolist()
    stamps[10], stamps[20], stamps[21] = stamps[9], stamps[15], stamps[16]
    with pytest.raises(WrenchflowError, match="1 stamps of 'wrench_raw' repeat the one before, and 2 go back"):
        imported(tmp_path, kind, stamps=stamps)
    (tmp_path / "again").mkdir()
    said = MAPPING.replace('"header"', '"header", disordered = "drop"')
    episode = imported(tmp_path / "again", kind, said, stamps)
    kept = np.setdiff1d(np.arange(N), [10, 20, 21])
    np.testing.assert_array_equal(episode["wrench_raw"].data, WRENCHES[kept])
    assert episode.meta["import"]["dropped"] == {"joint_states": 3, "tcp_pose": 3, "wrench_raw": 3}


@pytest.mark.parametrize("kind", WRITERS)
def test_what_a_topic_does_not_have_is_told(tmp_path, kind):
    cases = {
        'topic = "/ft/dat"': "unknown topic of .*Did you mean '/?ft/data'",
        'topic = "/log"': "String|of no type known here",
        'topic = "/ft/data"\nposition = { unit = "mm" }': "is a 'wrench', which has no position",
        'topic = "/ft/data"\nforce = { columns = ["a"], unit = "N" }': "of a topic only the unit can be stated",
        'topic = "/ft/data"\nclock = { rate_hz = 10 }': "a topic has stamps of its own, got rate_hz",
        'force = { variable = "F", unit = "N" }\nclock = { rate_hz = 10 }': "a topic has to be stated",
    }
    path = WRITERS[kind](tmp_path, T.tolist())
    for said, told in cases.items():
        (tmp_path / "topics.toml").write_text(MAPPING.replace('topic = "/ft/data"', said))
        with pytest.raises(WrenchflowError, match=told):
            list(import_folder(tmp_path / "topics.toml", tmp_path / "out", [path], overwrite=True))
    (tmp_path / "topics.toml").write_text(MAPPING.replace('sign = "robot-on-environment"', ""))
    with pytest.raises(WrenchflowError, match="the sign is not stated"):
        list(import_folder(tmp_path / "topics.toml", tmp_path / "out", [path], overwrite=True))


@pytest.mark.parametrize("kind", WRITERS)
def test_a_header_that_nobody_filled_in_is_no_clock(tmp_path, kind):
    with pytest.raises(WrenchflowError, match=r"have no stamp in a header.*topic_time = 'log'"):
        imported(tmp_path, kind, stamps=[0] * N)


def test_a_bag_that_is_damaged_is_told(tmp_path):
    path = WRITERS["sqlite3 bag"](tmp_path, T.tolist())
    (database,) = path.glob("*.db3")
    database.write_bytes(database.read_bytes()[:5000])
    (tmp_path / "topics.toml").write_text(MAPPING)
    with pytest.raises(WrenchflowError, match="cannot be read as a ROS 2 bag"):
        list(import_folder(tmp_path / "topics.toml", tmp_path / "out", [path]))
    database.unlink()
    with pytest.raises(WrenchflowError, match="database files are missing"):
        list(import_folder(tmp_path / "topics.toml", tmp_path / "out", [path], overwrite=True))
