"""Reading a part is reading the whole and cutting it, in files of ours and of others; windows add up to the whole."""

import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import IndexType, Writer

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.messages import Messages
from wrenchflow.recording import codec, schemas
from wrenchflow.recording.container import Container
from wrenchflow.recording.images import image_messages
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.recording import Recording
from wrenchflow.recording.write import write_episode
from wrenchflow.recording.writer import EpisodeWriter
from wrenchflow.signals import JOINTS, POSE

S = 1_000_000_000


def ours(path: Path, seed: int) -> None:
    """Streams that pause for a second or a year, receive times that lag and jump, images and events."""
    rng = np.random.default_rng(seed)

    def stamps(n: int) -> np.ndarray:
        steps = rng.choice([1_000_000, 5_000_000, S, 400_000 * S], n, p=[0.9, 0.08, 0.0199, 0.0001])
        return int(rng.integers(0, 3 * S)) + np.cumsum(steps)

    fast, slow, camera = stamps(3000), stamps(200), stamps(60)
    late = fast + rng.integers(0, 3 * S, len(fast))
    pictures = image_messages(rng.permutation(camera), [rng.bytes(200)] * 60, "c", received=camera + 40_000_000)
    with EpisodeWriter(path, id="e", task="t") as writer:
        writer.add_stream("fast", JOINTS)
        writer.add_stream("slow", POSE)
        writer.add_stream("never", POSE)
        writer.add_messages("camera", pictures.type)
        for part in range(10):
            now = slice(300 * part, 300 * part + 300)
            writer.write("fast", fast[now], rng.normal(size=(300, 21)), received=late[now])
            now = slice(20 * part, 20 * part + 20)
            writer.write("slow", slow[now], rng.normal(size=(20, 7)))
            writer.write_messages("camera", pictures.part(slice(6 * part, 6 * part + 6)))
            start = int(rng.integers(0, 20 * S))
            writer.event(Event(start, start + S, "phase", str(part)))
        writer.finish()


def foreign(path: Path, seed: int, log_offset: int = 10**17, *, stamped: bool = True, indexed: bool = True) -> None:
    """Stamps and log times are years apart, and neither is in order."""
    rng = np.random.default_rng(seed)
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=3000, index_types=IndexType.ALL if indexed else IndexType.NONE)
        writer.start()
        message = "geometry_msgs/msg/PoseStamped"
        text = schemas.definition(message).encode()
        schema = writer.register_schema(message, "ros2msg", text)
        pose = writer.register_channel("/pose", "cdr", schema)
        log = writer.register_channel("/log", "json", writer.register_schema("l", "jsonschema", b"{}"))
        t = rng.permutation(np.arange(400) * 7_000_000).reshape(8, 50)
        for of in np.sort(t, axis=0).ravel().tolist():
            stamp = {"sec": of // S, "nanosec": of % S} if stamped else {}
            values = {"header": {"stamp": stamp, "frame_id": "f"}, "pose": {"position": {"x": of}}}
            writer.add_message(pose, log_offset - of, codec.encode(message, values), of + (17 if stamped else 0))
            writer.add_message(log, log_offset - of, b"{}", of)
        writer.finish()


FILES: dict[str, Callable[[Path, int], None]] = {
    "ours": ours,
    "foreign": foreign,
    "foreign without stamps": lambda path, seed: foreign(path, seed, stamped=False),
    "foreign without an index": lambda path, seed: foreign(path, seed, indexed=False),
}


@cache
def content(name: str, seed: int) -> bytes:
    """The bytes of a file of some kind."""
    with tempfile.TemporaryDirectory() as folder:
        FILES[name](Path(folder, "e.mcap"), seed)
        return Path(folder, "e.mcap").read_bytes()


def joined(parts: list[Episode], whole: Episode) -> Episode:
    """The windows of an episode, put together again."""
    streams = {}
    for name, stream in whole.streams.items():
        of = [part[name] for part in parts]
        t, data = np.concatenate([p.t for p in of]), np.concatenate([p.data for p in of])
        streams[name] = Stream(t, data, stream.signal, stream.frame)
    messages = {}
    for name, kept in whole.messages.items():
        of = [part.messages[name] for part in parts]
        columns = [np.concatenate([getattr(p, key) for p in of]) for key in ("t", "received", "sequence")]
        messages[name] = Messages(kept.type, *columns, [payload for p in of for payload in p.payloads])
    events = tuple(event for part in parts for event in part.events)
    return Episode(whole.id, whole.task, streams, events, whole.meta, messages, whole.attachments)


def in_order_of_time(messages: Messages) -> Messages:
    order = np.argsort(messages.t, kind="stable")
    columns = [getattr(messages, key)[order] for key in ("t", "received", "sequence")]
    return Messages(messages.type, *columns, [bytes(messages.payloads[i]) for i in order.tolist()])


@pytest.mark.parametrize("name", FILES)
@settings(max_examples=25)
@given(seed=st.integers(0, 2), edges=st.lists(st.integers(-1, 3 * 10**9), min_size=2, max_size=8))
def test_a_range_is_the_whole_cut(name: str, seed: int, edges: list[int]):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "e.mcap")
        path.write_bytes(content(name, seed))
        whole, recording = read_episode(path), Recording(path)
        pairs = [(edges[i], edges[i + 1]) for i in range(len(edges) - 1)]
        middle = int(whole.streams[recording.streams[0]].t[100])
        for start, stop in [*pairs, (middle, middle + 1), (middle + 1, middle + 10**9), (0, 2**62)]:
            part = recording.read(start_ns=start, stop_ns=stop)
            assert part.streams == {name: of.between(start, stop) for name, of in whole.streams.items()}
            assert part.messages == {name: of.between(start, stop) for name, of in whole.messages.items()}
            assert part.events == tuple(event for event in whole.events if start <= event.start_ns < stop)
            one = recording.streams[0]
            assert recording.read([one], start_ns=start, stop_ns=stop)[one] == part[one]
        assert recording.read(start_ns=middle)[recording.streams[0]].t[0] == middle
        assert recording.read() == whole


@pytest.mark.parametrize("write", FILES.values(), ids=FILES)
@pytest.mark.parametrize("length_ns", [150_000_000, S + 1, 10**18])
def test_windows_add_up_to_the_whole(tmp_path: Path, write: Callable, length_ns: int):
    write(tmp_path / "e.mcap", 3)
    whole, recording = read_episode(tmp_path / "e.mcap"), Recording(tmp_path / "e.mcap")
    windows = list(recording.windows(length_ns))
    messages = {name: in_order_of_time(of) for name, of in whole.messages.items()}
    found = joined(windows, whole)
    assert found.streams == whole.streams
    assert {name: in_order_of_time(of) for name, of in found.messages.items()} == messages
    assert found.events == whole.events
    for window in windows:
        stamps = [of.t for of in (*window.streams.values(), *window.messages.values()) if len(of)]
        stamps += [np.array([event.start_ns]) for event in window.events]
        assert max(t.max() for t in stamps) - min(t.min() for t in stamps) < length_ns
    first = recording.streams[0]
    alone = [window[first] for window in recording.windows(length_ns, [first])]
    np.testing.assert_array_equal(np.concatenate([part.t for part in alone]), whole[first].t)
    edge = int(whole[first].t[len(whole[first]) // 2])
    halves = [*recording.windows(length_ns, stop_ns=edge), *recording.windows(length_ns, start_ns=edge)]
    assert joined(halves, whole).streams == whole.streams


def test_chunks_outside_of_the_range_stay_closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    t = np.arange(60_000, dtype=np.int64) * 1_000_000
    pose = Stream(t, np.zeros((60_000, 7)), POSE, "base")
    write_episode(tmp_path / "e.mcap", Episode("e", "t", {"pose": pose}))
    opened = set()
    unpack = Container.unpack
    monkeypatch.setattr(Container, "unpack", lambda self, chunk: opened.add(id(chunk)) or unpack(self, chunk))
    recording = Recording(tmp_path / "e.mcap")
    assert opened == set()
    assert recording.streams == ("pose",)
    assert opened == set()
    assert len(recording.read(start_ns=30 * S, stop_ns=32 * S)["pose"]) == 2000
    assert len(opened) <= 4 + 2
