"""Other people's MCAP readers decode our files to the same values, and we read other people's files."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
from mcap_ros2.decoder import DecoderFactory
from mcap_ros2.writer import Writer as Ros2Writer
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import RecordingError
from wrenchflow.recording import schemas
from wrenchflow.recording.reader import read_episode, read_info
from wrenchflow.recording.write import write_episode
from wrenchflow.signals import (
    FORCE,
    GOVERNOR,
    IMPEDANCE,
    JOINT_TORQUE,
    JOINTS,
    JOY,
    POSE,
    REQUEST,
    TWIST,
    WRENCH,
    joints,
    mask,
)

N = 1300
T = 1_700_000_000_000_000_000 + np.arange(N, dtype=np.int64) * 1_000_000


def episode() -> Episode:
    rng = np.random.default_rng(1)
    signals = {
        "wrench_raw": WRENCH,
        "force": FORCE,
        "tcp_pose": POSE,
        "tcp_twist": TWIST,
        "joint_states": JOINTS,
        "joint_command": JOINT_TORQUE,
        "impedance": IMPEDANCE,
        "request": REQUEST,
        "governor": GOVERNOR,
    }
    streams = {name: Stream(T, rng.normal(size=(N, s.width)), s, "base") for name, s in signals.items()}
    joy = np.hstack((rng.integers(-350, 350, (N, 6)), rng.integers(0, 2, (N, 2)))).astype(np.float64)
    flags = rng.integers(0, 2, (N, 2)).astype(np.float64)
    streams |= {"teleop/joy": Stream(T, joy, JOY), "anomaly": Stream(T, flags, mask(("spike", "dropout")))}
    event = Event(int(T[10]), int(T[90]), "contact", "first\ntouch")
    return Episode("0007", "peg-insertion", streams, (event,), {"seed": 7})


def row(kind: str, m) -> tuple[float, ...]:
    """The columns of a signal, from a decoded message with the field names of ROS 2."""
    match kind:
        case "wrench":
            f, t = m.wrench.force, m.wrench.torque
            return f.x, f.y, f.z, t.x, t.y, t.z
        case "force":
            return m.vector.x, m.vector.y, m.vector.z
        case "pose":
            p, q = m.pose.position, m.pose.orientation
            return p.x, p.y, p.z, q.w, q.x, q.y, q.z
        case "twist":
            v, w = m.twist.linear, m.twist.angular
            return v.x, v.y, v.z, w.x, w.y, w.z
        case "joints":
            return *m.position, *m.velocity, *m.effort
        case "joint_torque":
            return tuple(m.effort)
        case "joy":
            return *m.axes, *m.buttons
        case _:
            return tuple(m.data)


def stamp_and_frame(m, log_time: int) -> tuple[int, str | None]:
    if not hasattr(m, "header"):
        return log_time, None
    return m.header.stamp.sec * 10**9 + m.header.stamp.nanosec, m.header.frame_id


def with_mcap_ros2(path: Path):
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for _, channel, message, decoded in reader.iter_decoded_messages():
            yield channel.topic, message.log_time, decoded


def with_rosbags(path: Path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Reader(path) as reader:
        for connection, log_time, data in reader.messages():
            yield connection.topic, log_time, store.deserialize_cdr(data, connection.msgtype)


@pytest.mark.parametrize("decode", [with_mcap_ros2, with_rosbags])
def test_other_readers_decode_the_same_values(tmp_path: Path, decode: Callable):
    expected = episode()
    path = tmp_path / "0007.mcap"
    write_episode(path, expected)
    stamps: dict[str, list[int]] = {name: [] for name in expected.streams}
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in expected.streams}
    for topic, log_time, message in decode(path):
        name = topic[1:]
        if name == "events":
            assert message.data == (
                f'{{"kind": "contact", "label": "first\\ntouch", "start_ns": {T[10]}, "stop_ns": {T[90]}}}'
            )
            continue
        stamp, frame = stamp_and_frame(message, log_time)
        assert frame in (expected[name].frame, None)
        assert stamp == log_time
        stamps[name].append(stamp)
        rows[name].append(row(expected[name].signal.kind, message))
    for name, stream in expected.streams.items():
        assert Stream(np.array(stamps[name]), np.array(rows[name], float), stream.signal, stream.frame) == stream


def test_names_and_labels_as_other_readers_see_them(tmp_path: Path):
    write_episode(tmp_path / "e.mcap", episode())
    seen = {topic: message for topic, _, message in with_mcap_ros2(tmp_path / "e.mcap")}
    assert list(seen["/joint_command"].name) == [f"panda_joint{i}" for i in range(1, 8)]
    assert len(seen["/joint_command"].position) == len(seen["/joint_command"].velocity) == 0
    (dimension,) = seen["/anomaly"].layout.dim
    assert (dimension.label, dimension.size, dimension.stride) == ("spike,dropout", 2, 2)


def test_every_definition_is_the_one_of_ros(tmp_path: Path):
    """The typestore knows the public definitions; hashes compare field by field, through all nested types."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    from rosbags.typesys import get_types_from_msg

    for message in (*schemas.STREAM_MESSAGES, schemas.EVENT_MESSAGE):
        types = get_types_from_msg(schemas.definition(message), message)
        for name, (_, fields) in types.items():
            assert [f[0] for f in fields] == [f[0] for f in store.fielddefs[name][1]], name
            assert [f[1] for f in fields] == [f[1] for f in store.fielddefs[name][1]], name


def pack_wrench(t: int, values: np.ndarray, frame: str, order: str = "<") -> bytes:
    """A WrenchStamped by hand: header, then six float64 at the next multiple of 8 after the encapsulation."""
    text = frame.encode() + b"\0"
    head = struct.pack(f"{order}iII", t // 10**9, t % 10**9, len(text)) + text
    head += bytes(-len(head) % 8)
    return (b"\0\1\0\0" if order == "<" else b"\0\0\0\0") + head + struct.pack(f"{order}6d", *values)


def write_foreign(path: Path, messages: list[tuple[int, bytes]], **options) -> None:
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(profile="ros2")
        message = "geometry_msgs/msg/WrenchStamped"
        schema = writer.register_schema(message, "ros2msg", schemas.definition(message).encode())
        other = writer.register_channel("/other", "cdr", schema)
        channel = writer.register_channel("/ft", "cdr", schema)
        text = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        log = writer.register_channel("/log", "cdr", text)
        for i, (t, data) in enumerate(messages):
            writer.add_message(log, t, b"\0\1\0\0\2\0\0\0a\0", t)
            writer.add_message(channel, t, data, t, i)
            writer.add_message(other, t, pack_wrench(t, np.arange(6.0), "tool"), t, i)
        writer.finish()


ALL_INDEXES = IndexType.ALL
OPTIONS = {
    "zstd": {},
    "lz4": {"compression": CompressionType.LZ4},
    "uncompressed": {"compression": CompressionType.NONE},
    "small chunks": {"chunk_size": 2000},
    "no message index": {"index_types": ALL_INDEXES & ~IndexType.MESSAGE},
    "no index at all": {"index_types": IndexType.NONE},
    "no chunks": {"use_chunking": False},
    "bare": {
        "index_types": IndexType.NONE,
        "use_statistics": False,
        "repeat_channels": False,
        "repeat_schemas": False,
        "use_summary_offsets": False,
    },
    "no checksums": {"enable_crcs": False},
}


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)
def test_files_of_the_mcap_package_are_read(tmp_path: Path, options: dict, order: str):
    values = np.random.default_rng(5).normal(size=(N, 6))
    path = tmp_path / "foreign.mcap"
    messages = [(int(t), pack_wrench(int(t), v, "sensor", order)) for t, v in zip(T, values, strict=True)]
    write_foreign(path, messages, **options)
    found = read_episode(path)
    assert (found.id, found.task, dict(found.meta), found.events) == ("foreign", "", {}, ())
    assert sorted(found.streams) == ["ft", "other"]
    assert found["ft"] == Stream(T, values, WRENCH, "sensor")
    assert found["other"] == Stream(T, np.tile(np.arange(6.0), (N, 1)), WRENCH, "tool")
    assert sorted(read_episode(path, ["ft"]).streams) == ["ft"]
    topics = {topic.name: topic for topic in read_info(path).topics}
    assert (topics["/ft"].count, topics["/ft"].start_ns, topics["/ft"].stop_ns) == (N, T[0], T[-1])
    assert topics["/ft"].rate_hz == pytest.approx(1000.0)


def test_messages_that_only_look_different_are_read_one_by_one(tmp_path: Path):
    """Byte order and garbage in the padding change from message to message, the values do not."""
    values = np.random.default_rng(6).normal(size=(N, 6))
    messages = []
    for i, (t, v) in enumerate(zip(T, values, strict=True)):
        data = bytearray(pack_wrench(int(t), v, "tcp", "<>"[i % 2]))
        data[4 + 12 + 4 : 4 + 16] = bytes(0)
        data[2] = i % 250
        messages.append((int(t), bytes(data) + b"\xff" * (i % 3)))
    write_foreign(tmp_path / "f.mcap", messages)
    assert read_episode(tmp_path / "f.mcap")["ft"] == Stream(T, values, WRENCH, "tcp")


def test_a_frame_that_changes_is_refused(tmp_path: Path):
    messages = [(int(t), pack_wrench(int(t), np.zeros(6), "ab"[i // 900])) for i, t in enumerate(T)]
    write_foreign(tmp_path / "f.mcap", messages)
    with pytest.raises(RecordingError, match=r"'/ft' of .* 'header.frame_id', which is 'a' first and 'b' later"):
        read_episode(tmp_path / "f.mcap")
    assert len(read_episode(tmp_path / "f.mcap", ["other"])["other"]) == N


def test_stamps_that_repeat_are_refused_and_out_of_order_sorted(tmp_path: Path):
    shuffled = np.random.default_rng(0).permutation(N)
    messages = [(int(T[i]), pack_wrench(int(T[i]), np.full(6, float(i)), "s")) for i in shuffled]
    write_foreign(tmp_path / "f.mcap", messages)
    assert read_episode(tmp_path / "f.mcap")["ft"].column("fx").tolist() == list(range(N))
    write_foreign(tmp_path / "g.mcap", messages + messages[:1])
    with pytest.raises(RecordingError, match="strictly increase"):
        read_episode(tmp_path / "g.mcap")


def test_the_time_of_a_sample_is_its_header_stamp(tmp_path: Path):
    write_foreign(tmp_path / "f.mcap", [(int(t), pack_wrench(int(t) - 5_000_000, np.zeros(6), "s")) for t in T])
    assert (read_episode(tmp_path / "f.mcap")["ft"].t == T - 5_000_000).all()


def test_messages_that_the_index_misses_are_noticed(tmp_path: Path):
    path = tmp_path / "f.mcap"
    write_foreign(path, [(int(t), pack_wrench(int(t), np.zeros(6), "s")) for t in T], enable_crcs=False)
    stated, more = struct.pack("<HQ", 2, N), struct.pack("<HQ", 2, N + 1)
    assert path.read_bytes().count(stated) == 1
    path.write_bytes(path.read_bytes().replace(stated, more))
    with pytest.raises(RecordingError, match=f"'/ft' has {N} messages where {N + 1} are stated"):
        read_episode(path)


def test_sequence_numbers_count_the_samples_of_a_topic(tmp_path: Path):
    write_episode(tmp_path / "e.mcap", episode())
    with (tmp_path / "e.mcap").open("rb") as file:
        messages = list(make_reader(file).iter_messages(topics=["/tcp_pose"]))
    assert [message.sequence for _, _, message in messages] == list(range(N))
    assert all(message.publish_time == message.log_time for _, _, message in messages)


def test_a_header_that_was_never_filled_in_gives_way_to_the_publish_time(tmp_path: Path):
    write_foreign(tmp_path / "f.mcap", [(int(t), pack_wrench(0, np.zeros(6), "s")) for t in T])
    assert (read_episode(tmp_path / "f.mcap")["ft"].t == T).all()


def test_joint_states_as_other_robots_send_them(tmp_path: Path):
    """Without velocities and efforts the columns are NaN: they were never measured."""
    path = tmp_path / "robot.mcap"
    writer = Ros2Writer(str(path))
    message = "sensor_msgs/msg/JointState"
    schema = writer.register_msgdef(message, schemas.definition(message))
    for i, t in enumerate(T[:5].tolist()):
        header = {"stamp": {"sec": t // 10**9, "nanosec": t % 10**9}, "frame_id": "world"}
        velocity = [1.0, 2.0] if i == 3 else []
        state = {"header": header, "name": ["a", "b"], "position": [i, -i], "velocity": velocity, "effort": []}
        writer.write_message("joint_states", schema, state, t)
    writer.finish()
    stream = read_episode(path)["joint_states"]
    assert stream.signal == joints(2)
    assert stream.column("q2").tolist() == [0, -1, -2, -3, -4]
    assert np.isnan(stream.column("tau1")).all()
    assert stream.column("dq2")[3] == 2.0
    assert np.isnan(stream.column("dq2")[[0, 1, 2, 4]]).all()
