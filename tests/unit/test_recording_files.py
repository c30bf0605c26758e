"""What becomes of files that are taken, unfinished, cut short or damaged; and what a file says about itself."""

from pathlib import Path

import numpy as np
import pytest

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import OutputError, RecordingError, StreamError, WrenchflowError
from wrenchflow.messages import Attachment
from wrenchflow.recording.reader import read_episode, read_info
from wrenchflow.recording.write import write_episode
from wrenchflow.recording.writer import EpisodeWriter
from wrenchflow.signals import JOY, POSE, WRENCH, Signal

T = np.arange(1, 1201, dtype=np.int64) * 1_000_000


def episode(n: int = 1200) -> Episode:
    rng = np.random.default_rng(0)
    streams = {"tcp_pose": Stream(T[:n], rng.normal(size=(n, 7)), POSE, "base")}
    streams["wrench_raw"] = Stream(T[:n], rng.normal(size=(n, 6)), WRENCH, "sensor")
    event = Event(int(T[0]), int(T[5]), "phase", "approach")
    return Episode("0001", "peg-insertion", streams, (event,), {"seed": 1, "result": {"success": True}})


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "0001.mcap"
    write_episode(path, episode(60))
    return path.read_bytes()


def test_a_file_cut_anywhere_is_refused(tmp_path: Path, whole: bytes):
    path = tmp_path / "cut.mcap"
    for length in [*range(0, len(whole), 97), *range(len(whole) - 60, len(whole))]:
        path.write_bytes(whole[:length])
        for read in (read_episode, read_info):
            with pytest.raises(RecordingError, match=r"cut\.mcap is truncated"):
                read(path)


def test_a_file_cut_in_the_middle_but_with_its_end_is_refused(tmp_path: Path, whole: bytes):
    path = tmp_path / "cut.mcap"
    for start in range(8, len(whole) - 60, 301):
        path.write_bytes(whole[:start] + whole[start + 13 :])
        with pytest.raises(RecordingError):
            read_episode(path)


def test_every_flipped_byte_is_found(tmp_path: Path, whole: bytes):
    path = tmp_path / "flipped.mcap"
    for at in range(0, len(whole), 31):
        damaged = bytearray(whole)
        damaged[at] ^= 1 << at % 8
        path.write_bytes(damaged)
        with pytest.raises(RecordingError, match=r"flipped\.mcap"):
            read_episode(path)


def test_chunk_checksums_hold_without_the_one_over_the_file(tmp_path: Path, whole: bytes, monkeypatch):
    """Other writers leave the checksum of the data out; those of the chunks must be enough for their content."""
    from wrenchflow.recording import container

    path = tmp_path / "e.mcap"
    path.write_bytes(whole)
    (chunk,) = container.Container(path).chunks
    at = whole.index(chunk.data.tobytes())
    end = len(whole) - 8 - 29
    summary = int.from_bytes(whole[end + 9 : end + 17], "little")
    for offset in range(0, len(chunk.data), 173):
        damaged = bytearray(whole)
        damaged[summary - 4 : summary] = bytes(4)
        damaged[at + offset] ^= 4
        path.write_bytes(damaged)
        with pytest.raises(RecordingError, match="chunk"):
            read_episode(path)


def test_what_is_not_a_recording_is_said_in_one_line(tmp_path: Path):
    (tmp_path / "text.mcap").write_text("not a recording at all, but long enough to hold a footer and more")
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "e.mcap.partial").write_bytes(b"\x89MCAP0\r\n")
    cases = {
        "missing.mcap": "cannot read .*missing.mcap: no such file or directory",
        "text.mcap": "text.mcap is not an MCAP file: it starts with 6e6f7420",
        "empty.mcap": "empty.mcap is truncated: its end is missing .it has 0 bytes",
        "e.mcap.partial": "e.mcap.partial is an unfinished recording",
        ".": "cannot read .*: is a directory",
    }
    for name, message in cases.items():
        for read in (read_episode, read_info):
            with pytest.raises(RecordingError, match=message) as caught:
                read(tmp_path / name)
            assert "\n" not in str(caught.value)


def test_a_stream_that_is_not_there(tmp_path: Path):
    write_episode(tmp_path / "e.mcap", episode())
    with pytest.raises(RecordingError, match=r"stream 'wrench' is not in .*e.mcap. It has: tcp_pose, wrench_raw\."):
        read_episode(tmp_path / "e.mcap", ["wrench"])


def test_an_existing_file_is_never_overwritten(tmp_path: Path):
    path = tmp_path / "e.mcap"
    path.write_text("precious")
    with pytest.raises(OutputError, match="exists already"):
        write_episode(path, episode())
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_is_not_there(tmp_path: Path):
    with pytest.raises(OutputError, match=r"cannot write .*no such file or directory"):
        write_episode(tmp_path / "nowhere" / "e.mcap", episode())


@pytest.mark.parametrize("interruption", [KeyboardInterrupt, RuntimeError])
def test_an_interrupted_recording_stays_partial(tmp_path: Path, interruption: type[BaseException]):
    path = tmp_path / "e.mcap"
    pose = episode()["tcp_pose"]

    def record() -> None:
        with EpisodeWriter(path, id="e", task="t") as writer:
            writer.add_stream("tcp_pose", POSE, "base")
            writer.write("tcp_pose", pose.t, pose.data)
            raise interruption

    with pytest.raises(interruption):
        record()
    assert [p.name for p in tmp_path.iterdir()] == ["e.mcap.partial"]
    write_episode(path, episode())
    assert [p.name for p in tmp_path.iterdir()] == ["e.mcap"]
    assert read_episode(path) == episode()


def test_chunks_are_in_the_file_while_it_is_written(tmp_path: Path):
    pose = episode()["tcp_pose"]
    with EpisodeWriter(tmp_path / "e.mcap", id="e", task="t") as writer:
        writer.add_stream("tcp_pose", POSE, "base")
        sizes = []
        for i in range(0, 1200, 300):
            writer.write("tcp_pose", pose.t[i : i + 300], pose.data[i : i + 300])
            sizes.append((tmp_path / "e.mcap.partial").stat().st_size)
    assert sizes[0] == 0
    assert 0 < sizes[1] < sizes[3]


BAD_ROWS = {
    "a width": (T[:2], np.zeros((2, 6)), "takes data of shape"),
    "a clock that stands": (T[[0, 0]], np.zeros((2, 7)), "strictly increase"),
    "a time before the last": (T[:1] - T[0], np.zeros((1, 7)), "takes stamps after 1000000 ns"),
    "a time that ROS cannot hold": (T[:1] + 2**62, np.zeros((1, 7)), "takes stamps after"),
}


@pytest.mark.parametrize(("t", "rows", "message"), BAD_ROWS.values(), ids=BAD_ROWS)
def test_samples_that_break_the_rules_are_refused(tmp_path: Path, t: np.ndarray, rows: np.ndarray, message: str):
    with EpisodeWriter(tmp_path / "e.mcap", id="e", task="t") as writer:
        writer.add_stream("tcp_pose", POSE, "base")
        writer.write("tcp_pose", T[:1], np.zeros((1, 7)))
        with pytest.raises(StreamError, match=message):
            writer.write("tcp_pose", t, rows)
    assert len(read_episode(tmp_path / "e.mcap")["tcp_pose"]) == 1


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("x", 0.1, "column 'x' of a 'joy' is recorded as float32, which cannot hold 0.1 .row 1."),
        ("rz", 1e300, "float32"),
        ("button_left", 0.5, "column 'button_left' of a 'joy' is recorded as int32, which cannot hold 0.5"),
        ("button_right", np.nan, "int32, which cannot hold nan"),
        ("button_right", 2.0**31, "int32"),
    ],
)
def test_values_that_would_not_survive_are_refused(tmp_path: Path, column: str, value: float, message: str):
    rows = np.zeros((3, 8))
    rows[1, JOY.columns.index(column)] = value
    with pytest.raises(StreamError, match=message):
        write_episode(tmp_path / "e.mcap", Episode("e", "t", {"teleop/joy": Stream(T[:3], rows, JOY)}))
    assert not (tmp_path / "e.mcap").exists()


def test_streams_and_meta_that_cannot_be_recorded(tmp_path: Path):
    cases: list[tuple[Episode, str]] = [
        (episode().with_stream("x", Stream(T, np.zeros((1200, 1)), Signal("heat", ("c",), ("K",)))), "'heat'. Availab"),
        (episode().with_stream("x", Stream(T, np.zeros((1200, 1)), Signal("pose", ("c",), ("m",)))), "takes 7 columns"),
        (episode().with_stream("events", episode()["tcp_pose"]), "the name is taken"),
        (episode().with_meta(seed=np.int64(3)), "meta 'seed' cannot be recorded: .*int64.*JSON values"),
        (episode().with_events(Event(-1, 0, "phase")), "event 'phase' takes times from 0"),
    ]
    for i, (bad, message) in enumerate(cases):
        with pytest.raises(WrenchflowError, match=message):
            write_episode(tmp_path / f"{i}.mcap", bad)
        assert not (tmp_path / f"{i}.mcap").exists()


def test_streams_are_added_before_the_first_chunk(tmp_path: Path):
    with EpisodeWriter(tmp_path / "e.mcap", id="e", task="t") as writer:
        writer.add_stream("tcp_pose", POSE, "base")
        with pytest.raises(StreamError, match=r"unknown stream 'tcp_pos'. Did you mean 'tcp_pose'"):
            writer.write("tcp_pos", T, np.zeros((1200, 7)))
        writer.write("tcp_pose", T, np.zeros((1200, 7)))
        with pytest.raises(StreamError, match="too late"):
            writer.add_stream("wrench", WRENCH)


def test_info_tells_what_is_there(tmp_path: Path):
    path = tmp_path / "0001.mcap"
    write_episode(path, episode())
    info = read_info(path)
    assert (info.id, info.task, info.meta["result"]) == ("0001", "peg-insertion", {"success": True})
    assert info.size_bytes == path.stat().st_size
    assert info.duration_s == pytest.approx(1.199)
    events, pose, wrench = info.topics
    assert (events.name, events.schema, events.count, events.rate_hz) == ("/events", "std_msgs/msg/String", 1, None)
    assert (pose.name, pose.schema, pose.count) == ("/tcp_pose", "geometry_msgs/msg/PoseStamped", 1200)
    assert pose.rate_hz == pytest.approx(1000.0)
    assert (wrench.start_ns, wrench.stop_ns) == (T[0], T[-1])


def test_info_tells_pauses_chunks_and_attachments(tmp_path: Path):
    t = np.delete(T, slice(700, 720))
    wrench = Stream(t, np.zeros((len(t), 6)), WRENCH, "sensor")
    attached = Attachment(data=b"mass = 1", media_type="application/toml")
    late = Stream(T[[0, 50, 100, 150, 1150]], np.zeros((5, 7)), POSE)
    now_and_then = Stream(T[[0, 10, 200, 250, 1000]], np.zeros((5, 7)), POSE)
    streams = {"wrench_raw": wrench, "late": late, "now_and_then": now_and_then}
    write_episode(tmp_path / "e.mcap", Episode("e", "", streams, attachments={"rig.toml": attached}))
    info = read_info(tmp_path / "e.mcap")
    topics = {topic.name: topic for topic in info.topics}
    assert (topics["/wrench_raw"].gaps, topics["/wrench_raw"].longest_pause_s) == (1, 0.021)
    assert (topics["/late"].gaps, topics["/late"].longest_pause_s) == (1, 1.0)
    assert (topics["/now_and_then"].gaps, topics["/now_and_then"].longest_pause_s) == (None, 0.75)
    assert (topics["/events"].gaps, topics["/events"].longest_pause_s) == (None, None)
    assert dict(info.chunks) == {"zstd": 3}
    assert {name: (of.size_bytes, of.media_type) for name, of in info.attachments.items()} == {
        "rig.toml": (8, "application/toml")
    }


def test_info_does_not_decompress(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    from wrenchflow.recording.container import Container

    path = tmp_path / "0001.mcap"
    write_episode(path, episode())

    def refuse(self: Container, chunk: object) -> None:
        raise AssertionError("decompressed")

    monkeypatch.setattr(Container, "unpack", refuse)
    assert read_info(path).id == "0001"


def test_a_newer_format_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("wrenchflow.recording.writer.FORMAT_VERSION", 2)
    write_episode(tmp_path / "e.mcap", episode())
    with pytest.raises(RecordingError, match="format version 2; this wrenchflow reads versions up to 1"):
        read_episode(tmp_path / "e.mcap")
