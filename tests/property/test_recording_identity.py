"""Write then read is the identity, bit for bit, whatever the streams hold; equal episodes give equal bytes."""

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.messages import Attachment, Messages, MessageType
from wrenchflow.recording.images import image_messages, images_of
from wrenchflow.recording.pending import CHUNK_BYTES, CHUNK_NS
from wrenchflow.recording.reader import read_episode, read_info
from wrenchflow.recording.schemas import message_type
from wrenchflow.recording.write import write_episode
from wrenchflow.recording.writer import EpisodeWriter
from wrenchflow.signals import (
    FORCE,
    GOVERNOR,
    IMPEDANCE,
    JOINTS,
    JOY,
    POSE,
    REQUEST,
    TWIST,
    WRENCH,
    Signal,
    joint_torque,
    joints,
    mask,
)

KINDS = {
    "wrench": WRENCH,
    "force": FORCE,
    "pose": POSE,
    "twist": TWIST,
    "joints": JOINTS,
    "gripper": joints(1),
    "joint_torque": joint_torque(7),
    "impedance": IMPEDANCE,
    "request": REQUEST,
    "governor": GOVERNOR,
    "joy": JOY,
    "mask": mask(("spike", "drop, out", "saturation")),
}
LAST_NS = 2**31 * 1_000_000_000 - 1


def samples(rng: np.random.Generator, signal: Signal, n: int) -> np.ndarray:
    """Any bits that the signal's message can hold: NaN payloads, infinities and subnormals where it holds float64."""
    if signal.kind == "mask":
        return rng.integers(0, 256, (n, signal.width)).astype(np.float64)
    if signal.kind == "joy":
        axes = rng.normal(size=(n, 6)).astype(np.float32).astype(np.float64)
        return np.hstack((axes, rng.integers(-(2**31), 2**31, (n, 2)).astype(np.float64)))
    return rng.integers(0, 2**64, (n, signal.width), dtype=np.uint64).view(np.float64)


def stream(kind: str, seed: int, n: int, step: int, start: int, frame: str) -> Stream:
    rng = np.random.default_rng(seed)
    t = min(start, LAST_NS - 2 * n * step) + np.cumsum(rng.integers(1, 1 + 2 * step, n))
    return Stream(t.astype(np.int64), samples(rng, KINDS[kind], n), KINDS[kind], frame)


# Arguments of `stream`: hypothesis wants nothing random inside its strategies.
STREAMS = st.tuples(
    st.sampled_from(sorted(KINDS)),
    st.integers(0, 2**32),
    st.sampled_from([0, 1, 2, 7, 300]),
    st.sampled_from([1, 1_000_000, 33_333_333, 2_000_000_000]),
    st.sampled_from([0, 1, 999_999_999, 1_700_000_000_123_456_789, LAST_NS]),
    st.sampled_from(["", "base", "sensor/ä"]),
)
TEXT = st.text(st.characters(codec="utf-8"), max_size=8)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | TEXT,
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(TEXT, inner, max_size=3),
    max_leaves=6,
)
EVENTS = st.builds(
    lambda start, length, kind, label: Event(start, start + length, kind, label),
    st.integers(0, 10**18),
    st.integers(0, 10**12),
    TEXT,
    TEXT,
)
TYPES = {
    "json": MessageType(name="log", definition=b"{}", schema_encoding="jsonschema", encoding="json"),
    "protobuf": MessageType(name="a.B", definition=b"\x0a\xff", schema_encoding="protobuf", encoding="protobuf"),
    "no schema": MessageType(name="", definition=b"", schema_encoding="", encoding="x"),
    "a pose": MessageType(
        name="geometry_msgs/msg/PoseStamped", definition=b"?", schema_encoding="ros2msg", encoding="cdr"
    ),
    "columns that nobody names": message_type("std_msgs/msg/Float64MultiArray"),
}


def messages(kind: str, seed: int, n: int, longest: int) -> Messages:
    """Anything, in any order; images are what images are."""
    rng = np.random.default_rng(seed)
    t, received = rng.integers(0, LAST_NS, (2, n))
    sequence = rng.integers(0, 2**32, n)
    payloads = tuple(rng.bytes(int(length)) for length in rng.integers(0, longest, n))
    if kind == "image":
        return image_messages(t, payloads, "camera/ä", received=received, sequence=sequence)
    return Messages(TYPES[kind], t, received, sequence, payloads)


MESSAGES = st.tuples(
    st.sampled_from([*sorted(TYPES), "image"]),
    st.integers(0, 2**32),
    st.sampled_from([0, 1, 5, 40]),
    st.sampled_from([1, 100, 60_000]),
)
ATTACHMENTS = st.builds(
    lambda data, media_type, log, create: Attachment(
        data=data, media_type=media_type, log_time_ns=log, create_time_ns=create
    ),
    st.binary(max_size=100),
    st.sampled_from(["", "application/json"]),
    st.integers(0, 2**64 - 1),
    st.integers(0, 2**64 - 1),
)
NAMES = st.sampled_from(["wrench_raw", "tcp_pose", "teleop/joy", "teleop/twist", "a", "ü"])
META = st.dictionaries(
    TEXT | st.sampled_from(["id", "streams", "result", "safety", "recorded", "format_version"]), JSON, max_size=4
)


@given(
    st.dictionaries(NAMES, STREAMS, max_size=4),
    st.lists(EVENTS, max_size=5),
    META,
    TEXT,
    TEXT,
    st.dictionaries(st.sampled_from(["camera/wrist", "log", "x.2"]), MESSAGES, max_size=3),
    st.dictionaries(TEXT, ATTACHMENTS, max_size=2),
)
def test_write_then_read_is_the_identity(
    streams: dict, events: list[Event], meta: dict, id: str, task: str, others: dict, attachments: dict
):
    episode = Episode(
        id,
        task,
        {name: stream(*of) for name, of in streams.items()},
        tuple(events),
        meta,
        {name: messages(*of) for name, of in others.items()},
        attachments,
    )
    with tempfile.TemporaryDirectory() as folder:
        first, second = Path(folder, "first.mcap"), Path(folder, "second.mcap")
        write_episode(first, episode)
        write_episode(second, episode)
        assert first.read_bytes() == second.read_bytes()
        found = read_episode(first)
        assert found == episode
        assert (list(found.streams), list(found.messages)) == (list(episode.streams), list(episode.messages))
        write_episode(Path(folder, "again.mcap"), found)
        assert Path(folder, "again.mcap").read_bytes() == first.read_bytes()
        for name in episode.streams:
            alone = read_episode(first, [name])
            assert (list(alone.streams), list(alone.messages)) == ([name], [])
            assert alone[name] == episode[name]
            assert alone.events == episode.events
        for name in episode.messages:
            alone = read_episode(first, (), messages=[name])
            assert (list(alone.streams), dict(alone.messages)) == ([], {name: episode.messages[name]})
        info = read_info(first)
        assert (info.id, info.task, info.meta) == (episode.id, episode.task, episode.meta)
        counts = {topic.name: topic.count for topic in info.topics}
        held = {**episode.streams, **episode.messages}
        assert counts == {f"/{n}": len(of) for n, of in held.items()} | {"/events": len(episode.events)}


def test_an_image_is_not_copied(tmp_path: Path):
    pictures = [bytes([i]) * 1000 for i in range(30)]
    t = np.arange(30, dtype=np.int64) * 33_000_000
    write_episode(tmp_path / "e.mcap", Episode("e", "t", messages={"camera": image_messages(t, pictures, "wrist")}))
    held = read_episode(tmp_path / "e.mcap").messages["camera"]
    images = list(images_of(held))
    assert [bytes(image.data) for image in images] == pictures
    # All of them look into one mapped file.
    addresses = [np.frombuffer(image.data, np.uint8).ctypes.data for image in images]
    assert addresses == sorted(addresses)
    assert addresses[-1] - addresses[0] < (tmp_path / "e.mcap").stat().st_size
    assert held.payloads[3] == held.payloads[1:9][2:4][0]


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_every_kind_survives(tmp_path: Path, kind: str):
    rng = np.random.default_rng(3)
    t = np.arange(1, 2001, dtype=np.int64) * 1_000_000
    episode = Episode("e", "t", {"x": Stream(t, samples(rng, KINDS[kind], 2000), KINDS[kind], "base")})
    write_episode(tmp_path / "e.mcap", episode)
    assert read_episode(tmp_path / "e.mcap") == episode


@given(st.lists(st.integers(1, 5000), min_size=1, max_size=6))
def test_blocks_of_any_size_give_the_same_stream(blocks: list[int]):
    n = sum(blocks)
    t = np.arange(n, dtype=np.int64) * 1_000_000
    rows = np.random.default_rng(n).normal(size=(n, 21))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "e.mcap")
        with EpisodeWriter(path, id="e", task="t") as writer:
            writer.add_stream("joint_states", JOINTS)
            for start, length in zip(np.cumsum([0, *blocks]), blocks, strict=False):
                writer.write("joint_states", t[start : start + length], rows[start : start + length])
        assert read_episode(path)["joint_states"] == Stream(t, rows, JOINTS)


def test_each_chunk_covers_one_window_of_time(tmp_path: Path):
    from wrenchflow.recording.container import Container

    t = np.arange(4000, dtype=np.int64) * 1_000_000
    dense = {f"joints{i}": Stream(t, np.zeros((4000, 21)), JOINTS) for i in range(5)}
    late = Stream(t[::100] + 10**17, np.zeros((40, 6)), WRENCH)
    write_episode(tmp_path / "e.mcap", Episode("e", "t", {**dense, "wrench": late}))
    container = Container(tmp_path / "e.mcap")
    stop_before = -1
    for chunk in container.chunks:
        times = np.concatenate([index[:, 0] for index in chunk.index.values()]).astype(np.int64)
        assert times.min() > stop_before
        assert times.max() - times.min() < CHUNK_NS
        assert chunk.size <= CHUNK_BYTES
        stop_before = times.max()
