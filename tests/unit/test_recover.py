"""What is saved of a file that was cut off or damaged is true, is all that could be, and needs no luck."""

import struct
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from wrenchflow.describe import describe
from wrenchflow.episode import Episode, Stream
from wrenchflow.errors import OutputError, RecordingError
from wrenchflow.recording import codec, schemas
from wrenchflow.recording.container import Container
from wrenchflow.recording.file_format import RECOVERED
from wrenchflow.recording.reader import read_episode, read_info
from wrenchflow.recording.recover import recover
from wrenchflow.recording.validate import validate
from wrenchflow.recording.write import write_episode
from wrenchflow.signals import POSE, WRENCH

T = np.arange(1, 1201, dtype=np.int64) * 1_000_000


def episode(n: int) -> Episode:
    rng = np.random.default_rng(0)
    streams = {"tcp_pose": Stream(T[:n], rng.normal(size=(n, 7)), POSE, "base")}
    streams["wrench_raw"] = Stream(T[:n], rng.normal(size=(n, 6)), WRENCH, "sensor")
    return Episode("0001", "peg-insertion", streams, (), {"seed": 1, "result": {"success": True}})


def written(folder: Path, n: int) -> bytes:
    path = folder / "whole.mcap"
    write_episode(path, episode(n))
    return path.read_bytes()


def saved(folder: Path, content: bytes) -> Episode:
    """What is read from what is saved of `content`."""
    (folder / "cut.mcap.partial").write_bytes(content)
    out = folder / "saved.mcap"
    out.unlink(missing_ok=True)
    recover(folder / "cut.mcap.partial", out)
    # What was lost is missing from the counts that the closing record states; all else must be in order.
    assert [problem for problem in validate(out).problems if "its closing record states" not in problem] == []
    return read_episode(out)


def assert_prefix(part: Episode, whole: Episode) -> None:
    for name, stream in part.streams.items():
        n = len(stream)
        np.testing.assert_array_equal(stream.t, whole[name].t[:n])
        np.testing.assert_array_equal(stream.data, whole[name].data[:n])


@pytest.mark.parametrize("step", [23, pytest.param(1, marks=pytest.mark.slow)])
def test_a_small_file_cut_anywhere_gives_a_prefix_or_says_why_not(tmp_path, step):
    content, whole = written(tmp_path, 4), episode(4)
    (chunk,) = Container(tmp_path / "whole.mcap").chunks
    chunk_stop = content.index(chunk.data.tobytes()) + len(chunk.data)
    for length in range(0, len(content), step):
        try:
            part = saved(tmp_path, content[:length])
        except RecordingError:
            assert list(tmp_path.glob("saved*")) == []
            assert length < chunk_stop, "a file with a whole chunk was given up"
        else:
            assert_prefix(part, whole)


def test_all_but_the_chunk_that_was_cut_is_saved_and_most_of_that_one(tmp_path):
    content, whole = written(tmp_path, 1200), episode(1200)
    counts = []
    for length in range(len(content) // 2, len(content), len(content) // 16):
        part = saved(tmp_path, content[:length])
        assert_prefix(part, whole)
        counts.append(min(len(stream) for stream in part.streams.values()))
    assert counts == sorted(counts)
    assert counts[-1] >= 1000


def test_a_whole_file_is_saved_with_all_it_has(tmp_path):
    content = written(tmp_path, 50)
    assert saved(tmp_path, content) == episode(50)
    assert read_info(tmp_path / "saved.mcap").meta["result"] == {"success": True}


def test_a_chunk_with_a_changed_byte_is_left_out_and_the_others_are_kept(tmp_path):
    content, whole = written(tmp_path, 1200), episode(1200)
    starts = [at for at in range(len(content)) if content[at : at + 1] == b"\x06" and b"zstd" in content[at : at + 60]]
    assert len(starts) >= 3
    damaged = bytearray(content)
    damaged[starts[1] + 2000] ^= 1
    part = saved(tmp_path, bytes(damaged))
    kept = part["tcp_pose"].t
    assert 0 < len(kept) < 1200
    rows = np.searchsorted(T, kept)
    np.testing.assert_array_equal(part["tcp_pose"].data, whole["tcp_pose"].data[rows])
    assert (np.diff(kept) > 1_000_000).sum() == 1


@pytest.mark.parametrize("compression", [CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE])
@pytest.mark.parametrize("chunked", [True, False])
def test_files_of_the_mcap_package_that_were_cut_are_saved_too(tmp_path, compression, chunked):
    path, pose = tmp_path / "theirs.mcap", episode(600)["tcp_pose"]
    message = schemas.message_of(POSE)
    with path.open("wb") as file:
        writer = Writer(file, compression=compression, chunk_size=20_000, use_chunking=chunked)
        writer.start(profile="ros2", library="theirs")
        schema = writer.register_schema(message, "ros2msg", schemas.definition(message).encode())
        channel = writer.register_channel("/tcp_pose", "cdr", schema)
        for i, (t, row) in enumerate(zip(pose.t.tolist(), pose.data.tolist(), strict=True)):
            position = dict(zip("xyz", row[:3], strict=True))
            orientation = dict(zip("wxyz", row[3:], strict=True))
            header = {"stamp": {"sec": 0, "nanosec": t}, "frame_id": "base"}
            filled = {"header": header, "pose": {"position": position, "orientation": orientation}}
            writer.add_message(channel, t, codec.encode(message, filled), t, i)
        writer.finish()
    content = path.read_bytes()
    cut = content[: len(content) * 2 // 3]
    part = saved(tmp_path, cut)
    n = len(part["tcp_pose"])
    assert n > 250
    np.testing.assert_array_equal(part["tcp_pose"].data, pose.data[:n])


def test_a_chunk_that_claims_a_tebibyte_takes_no_memory(tmp_path):
    content = bytearray(written(tmp_path, 600))
    at = content.index(b"\x06", content.index(b"wrenchflow", 20))
    while b"zstd" not in content[at : at + 60]:
        at = content.index(b"\x06", at + 1)
    struct.pack_into("<Q", content, at + 9 + 16, 2**40)
    path = tmp_path / "huge.mcap"
    # Checksums that fit the lie, so that nothing else refuses it.
    end = len(content) - 8 - 29
    summary = int.from_bytes(content[end + 9 : end + 17], "little")
    struct.pack_into("<I", content, summary - 4, zlib.crc32(content[: summary - 13]))
    path.write_bytes(content)
    tracemalloc.start()
    with pytest.raises(RecordingError, match="claims 1099511627776 bytes"):
        read_episode(path)
    recover(path, tmp_path / "saved.mcap")
    assert tracemalloc.get_traced_memory()[1] < 64 * 2**20
    tracemalloc.stop()


def test_what_is_there_is_kept(tmp_path):
    content = written(tmp_path, 4)
    path = tmp_path / "e.mcap.partial"
    path.write_bytes(content)
    with pytest.raises(OutputError, match="is written through"):
        recover(path, tmp_path / "e.mcap")
    with pytest.raises(OutputError, match="exists already"):
        recover(path, tmp_path / "whole.mcap")
    assert path.read_bytes() == content


def test_a_recovered_file_says_so(tmp_path):
    content = written(tmp_path, 1200)
    saved(tmp_path, content[: len(content) // 2])
    assert "its end is missing" in Container(tmp_path / "saved.mcap").metadata[RECOVERED]["problems"]


@pytest.mark.parametrize("content", [b"", b"text", b"\x89MCAP0\r\n", b"\x89MCAP0\r\n" + bytes(50)])
def test_where_nothing_can_be_saved_nothing_is_left(tmp_path, content):
    (tmp_path / "x.mcap").write_bytes(content)
    with pytest.raises(RecordingError):
        recover(tmp_path / "x.mcap", tmp_path / "saved.mcap")
    assert [path.name for path in tmp_path.iterdir()] == ["x.mcap"]


def test_what_was_interrupted_says_how_it_is_saved(tmp_path):
    path = tmp_path / "e.mcap.partial"
    path.write_bytes(written(tmp_path, 4)[:-100])
    for look in (read_episode, read_info, describe):
        with pytest.raises(
            RecordingError, match=r"is an unfinished recording.*`wrenchflow recover .*e\.mcap\.partial`"
        ):
            look(path)


def test_validate_finds_an_index_and_counts_that_lie(tmp_path):
    content = bytearray(written(tmp_path, 60))
    path = tmp_path / "whole.mcap"
    assert validate(path).problems == ()
    report = validate(path).streams["tcp_pose"]
    assert (report.samples, report.gaps, report.not_finite) == (60, 0, 0)
    assert report.period_s == pytest.approx(1e-3)
    # The first entry of the first index leads to the second message.
    at = content.index(b"\x07", content.index(b"zstd"))
    while struct.unpack_from("<Q", content, at + 1)[0] != 6 + 60 * 16:
        at = content.index(b"\x07", at + 1)
    first, second = at + 9 + 6, at + 9 + 6 + 16
    content[first : first + 16] = content[second : second + 16]
    end = len(content) - 8 - 29
    summary = int.from_bytes(content[end + 9 : end + 17], "little")
    struct.pack_into("<I", content, summary - 4, zlib.crc32(content[: summary - 13]))
    path.write_bytes(content)
    assert validate(path).problems
