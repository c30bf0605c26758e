"""A bit that is flipped in any kind of record, and ids that are given out twice: an error, or what is true.

Every kind is worked through twice: as it is, where a checksum should notice; and with the checksums left out, as a
writer leaves the file that put the wrong bytes there itself. A process of its own does it, so that its memory can be
looked at, and an alarm ends a call that hangs.
"""

import contextlib
import json
import os
import resource
import signal
import struct
import subprocess
import sys
import tracemalloc
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Schema
from mcap.writer import MCAP0_MAGIC as MAGIC

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import RecordingError, WrenchflowError
from wrenchflow.messages import Attachment
from wrenchflow.recording.reader import read_episode, read_info
from wrenchflow.recording.recover import recover
from wrenchflow.recording.validate import validate
from wrenchflow.recording.write import write_episode
from wrenchflow.signals import POSE, WRENCH

MOST_BYTES = 512 * 2**20
HANG_S = 20
N = 40
KINDS = (
    "HEADER",
    "SCHEMA",
    "CHANNEL",
    "CHUNK",
    "MESSAGE",
    "MESSAGE_INDEX",
    "ATTACHMENT",
    "METADATA",
    "DATA_END",
    "STATISTICS",
    "CHUNK_INDEX",
    "ATTACHMENT_INDEX",
    "METADATA_INDEX",
    "SUMMARY_OFFSET",
    "FOOTER",
)


def episode() -> Episode:
    rng, t = np.random.default_rng(0), np.arange(1, N + 1, dtype=np.int64) * 1_000_000
    streams = {
        "tcp_pose": Stream(t, rng.normal(size=(N, 7)), POSE, "base"),
        "wrench_raw": Stream(t, rng.normal(size=(N, 6)), WRENCH, "sensor"),
    }
    attached = {"rig.toml": Attachment(data=b"x = 1\n", media_type="application/toml", log_time_ns=3)}
    event = Event(10**6, 2 * 10**6, "phase", "approach")
    return Episode("0001", "t", streams, (event,), {"result": {"success": True}}, attachments=attached)


def written(folder: Path, compression: str = "zstd") -> bytes:
    path = folder / "whole.mcap"
    path.unlink(missing_ok=True)
    write_episode(path, episode(), compression)
    return path.read_bytes()


def records(content: bytes) -> Iterator[tuple[Opcode, int, int]]:
    """Kind, first and last byte of each record outside of chunks."""
    at = len(MAGIC)
    while at < len(content) - len(MAGIC):
        opcode, length = struct.unpack_from("<BQ", content, at)
        yield Opcode(opcode), at, at + 9 + length
        at += 9 + length


def places(content: bytes, kind: str) -> list[tuple[int, int]]:
    """Where the records of a kind lie; messages lie in a chunk, which is not compressed then."""
    if kind != "MESSAGE":
        return [(start, stop) for opcode, start, stop in records(content) if opcode.name == kind]
    ((first, last),) = places(content, "CHUNK")
    at, found = first + 9 + 28 + 4 + 8, []
    while at < last:
        (length,) = struct.unpack_from("<Q", content, at + 1)
        found.append((at, at + 9 + length))
        at += 9 + length
    return found


def without_checksums(content: bytes) -> bytes:
    data = bytearray(content)
    for opcode, start, stop in records(content):
        if opcode == Opcode.CHUNK:
            data[start + 9 + 24 : start + 9 + 28] = bytes(4)
        elif opcode in (Opcode.DATA_END, Opcode.FOOTER, Opcode.ATTACHMENT):
            data[stop - 4 : stop] = bytes(4)
    return bytes(data)


def flipped(content: bytes, kind: str, rng: np.random.Generator, thorough: bool) -> Iterator[bytes]:
    """A bit of each of the first 31 bytes of a record, where its lengths and ids are, and of some others; or all.

    The record is the last of its kind, in the data and in the summary.
    """
    found = places(content, kind)
    ((end, _),) = places(content, "DATA_END")
    in_data = [place for place in found if place[0] < end]
    for start, stop in sorted({found[-1], *in_data[-1:]}):
        yield from flipped_within(content, start, stop, rng, thorough)


def flipped_within(content: bytes, start: int, stop: int, rng: np.random.Generator, thorough: bool) -> Iterator[bytes]:
    head = [
        (at, bit) for at in range(start, min(stop, start + 31)) for bit in (range(8) if thorough else (3 * at % 8,))
    ]
    body = [(at, int(rng.integers(0, 8))) for at in range(start + 31, stop)]
    for at, bit in (*head, *(body[i] for i in rng.permutation(len(body))[: 1000 if thorough else 12])):
        data = bytearray(content)
        data[at] ^= 1 << bit
        yield bytes(data)


def assert_true(found: Episode, whole: Episode) -> None:
    """Every sample that a stream of ours has is one that was written to it."""
    for name, stream in found.streams.items():
        if name in whole.streams and stream.signal == whole[name].signal:
            rows = np.searchsorted(whole[name].t, stream.t)
            np.testing.assert_array_equal(stream.t, whole[name].t[rows])
            np.testing.assert_array_equal(stream.data, whole[name].data[rows])


def said(work) -> object:
    """What a call gives, or None where it says in one line why not; anything else comes through."""
    signal.alarm(HANG_S)
    try:
        return work()
    except WrenchflowError as error:
        if "\n" in str(error):
            raise AssertionError(f"more than a line: {error}") from error
        return None
    finally:
        signal.alarm(0)


def work_through(folder: Path, kind: str, checked: bool, thorough: bool) -> dict[str, int]:
    whole, rng = episode(), np.random.default_rng(0)
    content = written(folder, "none" if kind == "MESSAGE" else "zstd")
    content = content if checked else without_checksums(content)
    path, out = folder / "flipped.mcap", folder / "saved.mcap"
    counts = dict.fromkeys(("flips", "read", "wrong", "valid", "recovered", "told", "whole"), 0)
    for data in flipped(content, kind, rng, thorough):
        path.write_bytes(data)
        out.unlink(missing_ok=True)
        found, info = said(lambda: read_episode(path)), said(lambda: read_info(path))
        checks, saved = said(lambda: validate(path)), said(lambda: recover(path, out))
        counts["flips"] += 1
        counts["read"] += found is not None and info is not None
        counts["wrong"] += found is not None and found != whole
        counts["valid"] += not checks.problems
        counts["recovered"] += saved is not None
        counts["told"] += saved is None or bool(saved.problems)
        if saved is not None and checked:
            again = said(lambda: read_episode(out))
            if again is not None:
                assert_true(again, whole)
                counts["whole"] += again.streams == whole.streams
    return counts


def cut_everywhere(folder: Path) -> int:
    """Cut a file at every byte; how many of the pieces somebody took for a recording."""
    content, path, taken = written(folder), folder / "cut.mcap", 0
    for length in range(len(content)):
        path.write_bytes(content[:length])
        taken += said(lambda: read_episode(path)) is not None
        taken += said(lambda: read_info(path)) is not None
        taken += not said(lambda: validate(path)).problems
    return taken


def run_all(folder: Path, thorough: bool) -> dict:
    os.fsync = lambda file: None  # The disk is not what is looked at here.
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    table = {
        f"{kind} {checked}": work_through(folder, kind, checked, thorough)
        for kind in KINDS
        for checked in (True, False)
    }
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    return {"grown": grown, "table": table, "cut": cut_everywhere(folder)}


@pytest.fixture(scope="module", params=["sampled", pytest.param("thorough", marks=pytest.mark.slow)])
def worked_through(request, tmp_path_factory) -> dict:
    command = [sys.executable, __file__, str(tmp_path_factory.mktemp("flips")), request.param]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)
    assert ran.returncode == 0, ran.stderr[-3000:]
    return json.loads(ran.stdout)


def test_no_flip_takes_much_memory(worked_through):
    assert worked_through["grown"] < MOST_BYTES


def test_a_file_that_is_cut_at_any_byte_is_no_recording(worked_through):
    assert worked_through["cut"] == 0


@pytest.mark.parametrize("kind", KINDS)
def test_a_flip_is_noticed_by_a_checksum(worked_through, kind):
    counts = worked_through["table"][f"{kind} True"]
    assert counts["flips"] >= 13  # A bit of each byte of the shortest record.
    assert (counts["read"], counts["wrong"], counts["valid"]) == (0, 0, 0)
    assert counts["told"] == counts["recovered"] == counts["flips"]
    if kind not in ("CHUNK", "MESSAGE"):
        # All samples are saved: where a record is lost, the summary says what it was, and where the next one is. Only
        # a record that turns into a message outside of chunks, which has no checksum, gets through.
        assert counts["whole"] >= 0.99 * counts["flips"]


@pytest.mark.parametrize("kind", KINDS)
def test_a_flip_that_no_checksum_notices_is_survived(worked_through, kind):
    counts = worked_through["table"][f"{kind} False"]
    assert counts["flips"] >= 13  # A bit of each byte of the shortest record.
    # The flips are worth something only if some get past all that refuses them.
    assert counts["read"] > 0 or kind == "DATA_END"
    if kind in ("MESSAGE", "MESSAGE_INDEX", "STATISTICS", "CHUNK_INDEX", "ATTACHMENT_INDEX", "METADATA_INDEX"):
        # The reader has no need of what is wrong there, other tools do, and `validate` looks at it.
        assert counts["valid"] < counts["read"]
    assert counts["recovered"] > 0.5 * counts["flips"]


# Where in a record it says where another one is.
LEADS = {
    Opcode.FOOTER: (9, 17),
    Opcode.CHUNK_INDEX: (25,),
    Opcode.ATTACHMENT_INDEX: (9,),
    Opcode.METADATA_INDEX: (9,),
}


def inserted(content: bytes, at: int, record: bytes) -> bytes:
    """A record more in the data section; footer and indices lead to where things have gone."""
    data = bytearray(without_checksums(content))
    for opcode, start, _ in records(content):
        for place in LEADS.get(opcode, ()):
            (led_to,) = struct.unpack_from("<Q", data, start + place)
            if led_to >= at:
                struct.pack_into("<Q", data, start + place, led_to + len(record))
    data[at:at] = record
    return bytes(data)


def record_of(kind: type[Schema] | type[Channel], content: bytes, start: int, stop: int):
    return kind.read(ReadDataStream(BytesIO(content[start + 9 : stop])))


def bytes_of(record: Schema | Channel) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


@pytest.mark.parametrize("kind", [Schema, Channel])
@pytest.mark.parametrize("number", [0, 1, -1])
def test_an_id_that_is_given_out_twice_to_the_same_is_no_fault(tmp_path, kind, number):
    """The format allows it, and some writers repeat channels in every chunk."""
    content, path = written(tmp_path), tmp_path / "twice.mcap"
    start, stop = [place for place in places(content, kind.__name__.upper()) if place[0] < len(content) // 2][number]
    path.write_bytes(inserted(content, stop, content[start:stop]))
    assert read_episode(path) == episode()
    assert read_info(path).topics == read_info(tmp_path / "whole.mcap").topics
    assert validate(path).problems == ()
    assert recover(path, tmp_path / "saved.mcap").problems == ()
    assert read_episode(tmp_path / "saved.mcap") == episode()


@pytest.mark.parametrize("kind", [Schema, Channel])
def test_an_id_that_is_given_out_twice_to_different_things_is_refused_and_the_first_is_saved(tmp_path, kind):
    content, path = written(tmp_path), tmp_path / "twice.mcap"
    ((chunk, _),) = places(content, "CHUNK")
    start, stop = [place for place in places(content, kind.__name__.upper()) if place[0] < chunk][-1]
    other = record_of(kind, content, start, stop)
    if isinstance(other, Schema):
        other.name, other.data = "std_msgs/msg/String", b"string data\n"
    else:
        other.topic = "/other"
    path.write_bytes(inserted(content, stop, bytes_of(other)))
    said = f"{kind.__name__.lower()} {other.id} is defined twice"
    for look in (read_episode, read_info):
        with pytest.raises(RecordingError, match=said):
            look(path)
    assert said in validate(path).problems[0]
    assert any(said in problem for problem in recover(path, tmp_path / "saved.mcap").problems)
    assert read_episode(tmp_path / "saved.mcap") == episode()


@pytest.mark.parametrize("kind", KINDS)
def test_a_record_that_claims_a_tebibyte_is_refused_and_what_precedes_it_is_saved(tmp_path, kind):
    content, path = bytearray(without_checksums(written(tmp_path, "none"))), tmp_path / "huge.mcap"
    start, _ = places(bytes(content), kind)[-1]
    struct.pack_into("<Q", content, start + 1, 2**40)
    path.write_bytes(content)
    tracemalloc.start()
    with pytest.raises(RecordingError):
        read_episode(path)
    assert validate(path).problems
    if KINDS.index(kind) >= KINDS.index("DATA_END"):
        recover(path, tmp_path / "saved.mcap")
        assert read_episode(tmp_path / "saved.mcap") == episode()
    else:
        with contextlib.suppress(RecordingError):
            recover(path, tmp_path / "saved.mcap")
            assert_true(read_episode(tmp_path / "saved.mcap"), episode())
    assert tracemalloc.get_traced_memory()[1] < 64 * 2**20
    tracemalloc.stop()


if __name__ == "__main__":
    sys.stdout.write(json.dumps(run_all(Path(sys.argv[1]), sys.argv[2] == "thorough")))
