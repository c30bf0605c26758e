"""What `foxglove-sdk` and `rosbags` write is read to the same values, and saved if it is cut or its writer dies."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import foxglove
import numpy as np
import pytest
from foxglove import Channel, Context, Schema
from foxglove.channels import PoseInFrameChannel
from foxglove.mcap import MCAPCompression, MCAPWriteOptions
from foxglove.messages import Pose, PoseInFrame, Quaternion, Timestamp, Vector3
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from wrenchflow.episode import Stream
from wrenchflow.errors import RecordingError
from wrenchflow.recording import codec, schemas
from wrenchflow.recording.container import Container
from wrenchflow.recording.reader import read_episode, read_info
from wrenchflow.recording.recover import recover
from wrenchflow.recording.validate import validate
from wrenchflow.signals import POSE, WRENCH

N = 2000
T = 1_700_000_000_000_000_000 + np.arange(N, dtype=np.int64) * 1_000_000
COMPRESSIONS = {"zstd": MCAPCompression.Zstd, "lz4": MCAPCompression.Lz4, "none": None}


def streams() -> dict[str, Stream]:
    rng = np.random.default_rng(3)
    return {
        "tcp_pose": Stream(T, rng.normal(size=(N, 7)), POSE, "base"),
        "wrench": Stream(T, rng.normal(size=(N, 6)), WRENCH, "sensor"),
    }


def filled(stream: Stream, i: int) -> dict:
    """A sample as the fields of its message."""
    seconds, nanoseconds = divmod(int(stream.t[i]), 10**9)
    header = {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": stream.frame}
    row = stream.data[i].tolist()
    if stream.signal == POSE:
        position, orientation = dict(zip("xyz", row[:3], strict=True)), dict(zip("wxyz", row[3:], strict=True))
        return {"header": header, "pose": {"position": position, "orientation": orientation}}
    force, torque = dict(zip("xyz", row[:3], strict=True)), dict(zip("xyz", row[3:], strict=True))
    return {"header": header, "wrench": {"force": force, "torque": torque}}


def write_foxglove(path: Path, options: MCAPWriteOptions, *, then_die: bool = False) -> None:
    """Poses and wrenches in CDR, and what only foxglove reads: typed messages, and JSON without a schema."""
    context, written = Context(), streams()
    writer = foxglove.open_mcap(path, context=context, writer_options=options)
    channels = {}
    for name, stream in written.items():
        message = schemas.message_of(stream.signal)
        schema = Schema(name=message, encoding="ros2msg", data=schemas.definition(message).encode())
        channels[name] = Channel(f"/{name}", schema=schema, message_encoding="cdr", context=context)
    typed, free = PoseInFrameChannel("/typed", context=context), Channel("/free", context=context)
    for i in range(N):
        for name, stream in written.items():
            data = codec.encode(schemas.message_of(stream.signal), filled(stream, i))
            channels[name].log(data, log_time=int(T[i]))
        if i % 10 == 0:
            at = Timestamp(sec=i, nsec=0)
            pose = Pose(position=Vector3(x=1.0, y=2.0, z=3.0), orientation=Quaternion(x=0.0, y=0.0, z=0.0, w=1.0))
            typed.log(PoseInFrame(timestamp=at, frame_id="base", pose=pose), log_time=int(T[i]))
            free.log({"any": ["thing", i]}, log_time=int(T[i]))
    if then_die:
        os.kill(os.getpid(), signal.SIGKILL)
    writer.close()


def assert_prefix(found: dict[str, Stream], least: int = 0) -> int:
    """Every stream is a beginning of what was written; samples of the shortest."""
    counts = []
    for name, whole in streams().items():
        n = len(found[name]) if name in found else 0
        if n:
            assert found[name] == Stream(whole.t[:n], whole.data[:n], whole.signal, whole.frame)
        counts.append(n)
    assert min(counts) >= least
    return min(counts)


@pytest.mark.parametrize("name", COMPRESSIONS)
def test_files_of_foxglove_are_read_to_the_same_values(tmp_path, name):
    path = tmp_path / "theirs.mcap"
    write_foxglove(path, MCAPWriteOptions(compression=COMPRESSIONS[name], chunk_size=50_000))
    found = read_episode(path)
    assert dict(found.streams) == streams()
    topics = {topic.name: topic for topic in read_info(path).topics}
    assert {topic: topics[topic].count for topic in topics} == {
        "/tcp_pose": N,
        "/wrench": N,
        "/typed": N // 10,
        "/free": N // 10,
    }
    assert topics["/typed"].schema == "foxglove.PoseInFrame"
    assert validate(path).problems == ()


@pytest.mark.parametrize(
    "options",
    [
        {"use_chunks": False},
        {"emit_message_indexes": False},
        {"emit_chunk_indexes": False, "emit_statistics": False, "repeat_channels": False, "repeat_schemas": False},
        {"calculate_chunk_crcs": False, "calculate_data_section_crc": False, "calculate_summary_section_crc": False},
        {"chunk_size": None},
    ],
    ids=lambda options: ", ".join(options),
)
def test_files_of_foxglove_with_less_in_them_are_read_too(tmp_path, options):
    path = tmp_path / "theirs.mcap"
    write_foxglove(path, MCAPWriteOptions(**options))
    assert dict(read_episode(path).streams) == streams()


@pytest.mark.parametrize(
    "name", [name if name == "zstd" else pytest.param(name, marks=pytest.mark.slow) for name in COMPRESSIONS]
)
def test_a_file_of_foxglove_cut_anywhere_is_saved_up_to_there(tmp_path, name):
    path, cut, saved = tmp_path / "theirs.mcap", tmp_path / "cut.mcap", tmp_path / "saved.mcap"
    write_foxglove(path, MCAPWriteOptions(compression=COMPRESSIONS[name], chunk_size=50_000))
    content, counts = path.read_bytes(), []
    first = bytes(Container(path).chunks[0].data)
    first_stop = content.index(first) + len(first)
    lengths = np.sort(np.random.default_rng(0).integers(0, len(content), 50))
    for length in lengths.tolist():
        cut.write_bytes(content[:length])
        saved.unlink(missing_ok=True)
        try:
            recover(cut, saved)
        except RecordingError:
            assert length < first_stop  # What the messages are is described in the first chunk.
            counts.append(0)
            continue
        counts.append(assert_prefix(dict(read_episode(saved).streams)))
        assert validate(saved).problems == ()
    assert counts == sorted(counts)
    # At any place at most two chunks are lost: the one that was cut, and what its end leaves of a stream in it.
    for length, count in zip(lengths.tolist(), counts, strict=True):
        assert count >= N * length / len(content) - 2 * 50_000 / 260


def test_where_the_chunk_that_describes_everything_is_damaged_the_summary_does(tmp_path):
    path = tmp_path / "theirs.mcap"
    write_foxglove(path, MCAPWriteOptions(chunk_size=50_000))
    content = bytearray(path.read_bytes())
    chunks = Container(path).chunks
    content[content.index(bytes(chunks[0].data)) + 3000] ^= 1
    path.write_bytes(content)
    saved = recover(path, tmp_path / "saved.mcap")
    assert saved.chunks == len(chunks) - 1
    assert any("had from the summary" in problem for problem in saved.problems)
    assert validate(tmp_path / "saved.mcap").problems == ()
    for name, stream in read_episode(tmp_path / "saved.mcap").streams.items():
        whole = streams()[name]
        first = N - len(stream)
        assert stream == Stream(whole.t[first:], whole.data[first:], whole.signal, whole.frame)


@pytest.mark.parametrize("name", COMPRESSIONS)
def test_a_file_of_foxglove_whose_writer_was_killed_is_saved(tmp_path, name):
    path = tmp_path / "theirs.mcap"
    ran = subprocess.run([sys.executable, __file__, str(path), name], check=False)
    assert ran.returncode == -signal.SIGKILL
    with pytest.raises(RecordingError, match="is truncated"):
        read_episode(path)
    found = recover(path, tmp_path / "saved.mcap")
    assert found.problems
    assert_prefix(dict(read_episode(tmp_path / "saved.mcap").streams), least=N // 2)


def test_messages_that_nobody_here_understands_are_saved_as_they_are(tmp_path):
    from mcap.reader import make_reader

    path = tmp_path / "theirs.mcap"
    write_foxglove(path, MCAPWriteOptions(chunk_size=50_000))
    path.write_bytes(path.read_bytes()[:-1000])
    recover(path, tmp_path / "saved.mcap")
    with (tmp_path / "saved.mcap").open("rb") as file:
        said = [json.loads(m.data) for _, _, m in make_reader(file, validate_crcs=True).iter_messages(topics=["/free"])]
    assert said == [{"any": ["thing", i]} for i in range(0, N, 10)]


@pytest.mark.parametrize("mode", [None, CompressionMode.STORAGE])
@pytest.mark.parametrize("version", [8, 9])
def test_bags_of_rosbags_are_read_to_the_same_values(tmp_path, mode, version):
    store, expected = get_typestore(Stores.ROS2_HUMBLE), streams()
    writer = Writer(tmp_path / "bag", version=version, storage_plugin=StoragePlugin.MCAP)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        for name, stream in expected.items():
            message = schemas.message_of(stream.signal)
            connection = writer.add_connection(f"/{name}", message, typestore=store)
            for i in range(N):
                made = store.deserialize_cdr(codec.encode(message, filled(stream, i)), message)
                writer.write(connection, int(T[i]), store.serialize_cdr(made, message))
        text = "std_msgs/msg/String"
        log = writer.add_connection("/log", text, typestore=store)
        writer.write(log, int(T[0]), store.serialize_cdr(store.types[text](data="hello"), text))
    (path,) = (tmp_path / "bag").glob("*.mcap")
    assert dict(read_episode(path).streams) == expected
    assert {topic.name: topic.count for topic in read_info(path).topics} == {"/log": 1, "/tcp_pose": N, "/wrench": N}
    assert validate(path).problems == ()
    content, cut = path.read_bytes(), tmp_path / "cut.mcap"
    cut.write_bytes(content[: len(content) * 2 // 3])
    recover(cut, tmp_path / "saved.mcap")
    found = dict(read_episode(tmp_path / "saved.mcap").streams)
    # The bag has one topic after the other: all of the first is there, and the beginning of the second.
    assert found["tcp_pose"] == expected["tcp_pose"]
    assert_prefix(found)


if __name__ == "__main__":
    options = MCAPWriteOptions(compression=COMPRESSIONS[sys.argv[2]], chunk_size=50_000)
    write_foxglove(Path(sys.argv[1]), options, then_die=True)
