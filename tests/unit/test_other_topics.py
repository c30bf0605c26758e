"""What is no stream is kept: topics of other writers, whatever they are, in their order and byte for byte."""

import struct
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer

from wrenchflow.episode import Episode
from wrenchflow.errors import RecordingError
from wrenchflow.messages import Attachment
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.pipeline import process_folder
from wrenchflow.recording import codec, schemas
from wrenchflow.recording.container import Container
from wrenchflow.recording.images import image_messages
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.recording import Recording
from wrenchflow.recording.write import write_episode

N = 300
T = 1_700_000_000_000_000_000 + np.arange(N, dtype=np.int64) * 10_000_000
WRENCH_MESSAGE = "geometry_msgs/msg/WrenchStamped"
OPTIONS = {
    "zstd": {"chunk_size": 4000},
    "lz4": {"compression": CompressionType.LZ4, "chunk_size": 4000},
    "uncompressed": {"compression": CompressionType.NONE},
    "no index at all": {"index_types": IndexType.NONE, "use_statistics": False},
    "no chunks": {"use_chunking": False},
}


def wrench(t: int, frame: str) -> bytes:
    header = {"stamp": {"sec": t // 10**9, "nanosec": t % 10**9}, "frame_id": frame}
    return codec.encode(WRENCH_MESSAGE, {"header": header, "wrench": {"force": {"x": 1.5}}})


def write_foreign(path: Path, **options) -> None:
    """Two streams, one of them with a second publisher in another frame, and six topics that are none."""
    with path.open("wb") as file:
        writer = Writer(file, **options)
        writer.start(profile="ros2")

        def channel(topic: str, name: str, encoding: str, data: bytes, message_encoding: str) -> int:
            schema = writer.register_schema(name, encoding, data) if name else 0
            return writer.register_channel(topic, message_encoding, schema)

        text = schemas.definition(WRENCH_MESSAGE).encode()
        array = schemas.definition("std_msgs/msg/Float64MultiArray").encode()
        ids = {
            "ft": channel("/ft", WRENCH_MESSAGE, "ros2msg", text, "cdr"),
            "ft.2": channel("/ft", WRENCH_MESSAGE, "ros2msg", text, "cdr"),
            "log": channel("/log", "rcl/Log", "jsonschema", b"{}", "json"),
            "log.2": channel("/log", "rcl/Log", "jsonschema", b"{}", "json"),
            "proto": channel("/proto", "a.B", "protobuf", b"\x0a", "protobuf"),
            "log as cdr": channel("/log", "std_msgs/msg/String", "ros2msg", b"string data\n", "cdr"),
            "array": channel("/array", "std_msgs/msg/Float64MultiArray", "ros2msg", array, "cdr"),
            "bare": channel("/bare", "", "", b"", "raw"),
            "odd": channel("/odd", WRENCH_MESSAGE, "ros2msg", text, "cdr"),
            "never": channel("/never", WRENCH_MESSAGE, "ros2msg", text, "cdr"),
        }
        numbers = {"layout": {}, "data": [1.0, 2.0]}
        for i, t in enumerate(T.tolist()):
            data = {
                "ft": wrench(t, "a"),
                "ft.2": wrench(t + 1, "b"),
                "log": b'{"i": %d}' % i,
                "log.2": b"second %d" % i,
                "proto": bytes(i),
                "log as cdr": b"\0\1\0\0\2\0\0\0a\0",
                "array": codec.encode("std_msgs/msg/Float64MultiArray", numbers),
                "bare": struct.pack("<I", i),
                "odd": b"not CDR at all",
            }
            for name, content in data.items():
                writer.add_message(ids[name], t + 7, content, t, i)
        writer.finish()


@pytest.mark.parametrize("options", OPTIONS.values(), ids=OPTIONS)
def test_every_topic_of_a_foreign_file_is_there(tmp_path: Path, options: dict):
    path = tmp_path / "f.mcap"
    write_foreign(path, **options)
    episode = read_episode(path)
    assert {name: stream.frame for name, stream in episode.streams.items()} == {"ft": "a", "ft.2": "b"}
    assert set(episode.messages) == {"log", "log.2", "proto", "array", "bare", "odd", "never"}
    with path.open("rb") as file:
        expected: dict[str, list] = {}
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            key = (channel.topic, channel.message_encoding, schema.name if schema else "")
            expected.setdefault(str(key), []).append(message)
    by_key = {
        str((f"/{name.split('.')[0]}", kept.type.encoding, kept.type.name)): kept
        for name, kept in episode.messages.items()
        if len(kept)
    }
    del expected[str(("/ft", "cdr", WRENCH_MESSAGE))]
    assert by_key.keys() == expected.keys()
    for key, kept in by_key.items():
        assert [bytes(payload) for payload in kept.payloads] == [message.data for message in expected[key]]
        assert kept.sequence.tolist() == [message.sequence for message in expected[key]]
        assert kept.t.tolist() == [message.publish_time for message in expected[key]]
        assert kept.received.tolist() == [message.log_time for message in expected[key]]
    assert len(episode.messages["log"]) == 2 * N
    assert len(episode.messages["never"]) == 0
    # What was read is written and read again as it was.
    write_episode(tmp_path / "ours.mcap", episode)
    ours = read_episode(tmp_path / "ours.mcap")
    assert (dict(ours.streams), dict(ours.messages)) == (dict(episode.streams), dict(episode.messages))


def test_names_that_are_not_there(tmp_path: Path):
    write_foreign(tmp_path / "f.mcap")
    with pytest.raises(
        RecordingError, match=r"topic 'logs' is not in .*f\.mcap\. It has: array, bare, log, log\.2, ne"
    ):
        read_episode(tmp_path / "f.mcap", (), messages=["logs"])
    with pytest.raises(RecordingError, match=r"stream 'log' is not in .*It has: ft, ft\.2\."):
        read_episode(tmp_path / "f.mcap", ["log"])


def test_who_reads_streams_opens_no_images(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write_foreign(tmp_path / "f.mcap")
    pictures = image_messages(T, [bytes(5000)] * N, "camera")
    streams = read_episode(tmp_path / "f.mcap").streams
    write_episode(tmp_path / "e.mcap", Episode("e", "t", streams, messages={"camera/wrist": pictures}))
    opened: list[str] = []
    unpack = Container.unpack
    monkeypatch.setattr(
        Container, "unpack", lambda self, chunk: opened.append(chunk.compression) or unpack(self, chunk)
    )
    monkeypatch.setattr(Container, "check", lambda self: opened.append("everything"))
    episode = Recording(tmp_path / "e.mcap").read(["ft"])
    assert len(episode["ft"]) == N
    assert set(opened) == {"zstd"}
    opened.clear()
    # Headers of images are read from the mapped file; the six chunks are not. Only the type checks that run under test
    # look at a payload now and then.
    held = Recording(tmp_path / "e.mcap").read((), messages=["camera/wrist"]).messages["camera/wrist"]
    assert (held.t == T).all()
    assert len(opened) < 3


def test_processing_carries_everything_through(recording, tmp_path: Path):
    write_foreign(tmp_path / "f.mcap")
    others = dict(read_episode(tmp_path / "f.mcap").messages)
    others["camera/wrist"] = image_messages(T, [bytes([i % 256]) * 100 for i in range(N)], "camera")
    attachments = {"notes.txt": Attachment(data=b"loose screw", media_type="text/plain")}
    raw = tmp_path / "raw"
    raw.mkdir()
    episode = recording()
    full = Episode(episode.id, episode.task, episode.streams, episode.events, episode.meta, others, attachments)
    write_episode(raw / "0001.mcap", full)
    list(process_folder(raw, tmp_path / "clean", ProcessConfig(), jobs=1))
    clean = read_episode(tmp_path / "clean" / "0001.mcap")
    assert dict(clean.messages) == others
    assert dict(clean.attachments) == attachments
    assert {"wrench", "wrench_zero_phase", *episode.streams} == set(clean.streams)
