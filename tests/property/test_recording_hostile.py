"""Files that were made to fill memory: a result or one line that says what is wrong, and never more than 512 MiB.

Each file is small and opens into much more. A process of its own reads it, so that its memory can be looked at.
"""

import json
import resource
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.records import Channel, DataEnd, Footer, Header, Metadata, Schema
from mcap.writer import MCAP0_MAGIC as MAGIC

from wrenchflow.errors import WrenchflowError
from wrenchflow.recording import codec
from wrenchflow.recording.layout import record_header
from wrenchflow.recording.reader import read_episode, read_info
from wrenchflow.recording.recording import Recording

MOST_BYTES = 512 * 2**20
MIB = 2**20
JOINTS = "sensor_msgs/msg/JointState"


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def zstd(pieces: Iterator[bytes], size: int = -1) -> bytes:
    """A frame of any length, made piece by piece; it states a size only where it is told one."""
    compressor = zstandard.ZstdCompressor().compressobj(size=size)
    return b"".join([*(compressor.compress(piece) for piece in pieces), compressor.flush()])


def lz4_frame(pieces: Iterator[bytes]) -> bytes:
    compressor = lz4.frame.LZ4FrameCompressor()
    return b"".join([compressor.begin(), *(compressor.compress(piece) for piece in pieces), compressor.flush()])


def chunk(content: bytes, size: int, compression: str = "zstd", index: list[int] | None = None) -> bytes:
    """A chunk that says that it opens into `size` bytes, and the index of its messages."""
    label = compression.encode()
    head = struct.pack("<QQQI", 0, 0, size, 0) + struct.pack("<I", len(label)) + label
    made = record(0x06, head + struct.pack("<Q", len(content)) + content)
    if index is not None:
        entries = b"".join(struct.pack("<QQ", i, offset) for i, offset in enumerate(index))
        made += record(0x07, struct.pack("<HI", 1, len(entries)) + entries)
    return made


def write(path: Path, chunks: list[bytes], message: str = "x", entries: dict[str, str] | None = None) -> None:
    builder = RecordBuilder()
    Header(profile="", library="").write(builder)
    Schema(id=1, data=b"", encoding="ros2msg", name=message).write(builder)
    Channel(id=1, topic="/x", message_encoding="cdr", metadata={}, schema_id=1).write(builder)
    if entries:
        Metadata(name="wrenchflow", metadata=entries).write(builder)
    head = builder.end()
    DataEnd(data_section_crc=0).write(builder)
    Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(builder)
    path.write_bytes(MAGIC + head + b"".join(chunks) + builder.end() + MAGIC)


def one_message(size: int) -> Iterator[bytes]:
    """A message of zeros that fills `size` bytes with its header."""
    yield record_header(1, size - 31, 0, 0)
    for start in range(31, size, MIB):
        yield bytes(min(MIB, size - start))


def claims(path: Path) -> None:
    write(path, [chunk(zstd(one_message(1000)), 2**40)])


def claims_without_compression(path: Path) -> None:
    write(path, [chunk(b"".join(one_message(1000)), 2**40, "")])


def frame_of_gigabytes(path: Path) -> None:
    write(path, [chunk(zstd(iter([bytes(MIB)] * 4096)), 200 * MIB)])


def frame_that_says_gigabytes(path: Path) -> None:
    write(path, [chunk(zstd(iter([bytes(MIB)] * 4096), 4096 * MIB), 4096 * MIB)])


def lz4_of_gigabytes(path: Path) -> None:
    write(path, [chunk(lz4_frame(iter([bytes(MIB)] * 800)), 250 * MIB, "lz4")])


def many_large_chunks(path: Path) -> None:
    size = 256 * MIB
    frames = zstd(one_message(size), size), zstd(one_message(size)), lz4_frame(one_message(size))
    kinds = ("zstd", "zstd", "lz4")
    write(path, [chunk(frame, size, kind, [0]) for _ in range(3) for frame, kind in zip(frames, kinds, strict=True)])


def many_small_messages(path: Path) -> None:
    """Eight million messages a chunk, and no index."""
    block = record_header(1, 1, 0, 0) + b"\0"
    count = 256 * MIB // len(block)
    frame = zstd(iter([block * 1024] * (count // 1024)))
    write(path, [chunk(frame, count // 1024 * 1024 * len(block))] * 8)


def many_joints(path: Path) -> None:
    """A single message that holds thirty million numbers."""
    cdr = codec.encode(JOINTS, {})[:-12] + struct.pack("<I", 30_000_000)
    head = record_header(1, len(cdr) + 240_000_000, 0, 0) + cdr
    frame = zstd(iter([head, *[bytes(MIB)] * 228, bytes(240_000_000 - 228 * MIB)]))
    write(path, [chunk(frame, len(head) + 240_000_000, index=[0])], JOINTS)


def one_wide_message(path: Path) -> None:
    """The first message has thousands of columns, the others none: each of them would be a row of NaN."""
    wide, none = (codec.encode(JOINTS, {"position": [0.0] * n}) for n in (1300, 0))
    first, other = record_header(1, len(wide), 0, 0) + wide, record_header(1, len(none), 0, 0) + none
    count = 200_000
    content = first + other * count
    index = [0, *(len(first) + i * len(other) for i in range(count))]
    write(path, [chunk(zstd(iter([content])), len(content), index=index)], JOINTS)


def window_of_gigabytes(path: Path) -> None:
    parameters = zstandard.ZstdCompressionParameters.from_level(1, window_log=30, enable_ldm=True)
    compressor = zstandard.ZstdCompressor(compression_params=parameters).compressobj()
    frame = b"".join([*(compressor.compress(bytes(MIB)) for _ in range(1100)), compressor.flush()])
    write(path, [chunk(frame, 100 * MIB)])


def deep_metadata(path: Path) -> None:
    entries = {"format_version": "1", "id": "x", "task": "t", "meta.x": "[" * 1_000_000, "streams": "{}"}
    write(path, [], entries=entries)


# Whether there is something to read.
FILES: dict[str, tuple[Callable[[Path], None], bool]] = {
    of.__name__: (of, is_read)
    for of, is_read in (
        (claims, False),
        (claims_without_compression, False),
        (frame_of_gigabytes, False),
        (frame_that_says_gigabytes, False),
        (lz4_of_gigabytes, False),
        (many_large_chunks, True),
        (many_small_messages, False),
        (many_joints, True),
        (one_wide_message, False),
        (window_of_gigabytes, False),
        (deep_metadata, False),
    )
}


def outcome(path: Path) -> dict[str, object]:
    """What reading it said, how many bytes of messages there are, and how much memory it took."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    said, held = [], 0

    def read() -> None:
        nonlocal held
        found = read_episode(path).messages.values()
        held = sum(len(of.payloads[i]) for of in found for i in range(len(of)))

    for work in (lambda: read_info(path), read, lambda: list(Recording(path).windows(10**9))):
        try:
            work()
        except WrenchflowError as error:
            said.append(str(error))
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    return {"said": said, "held": held, "grown": grown}


def warm_up(folder: Path) -> None:
    """Compile what reading compiles: that is not what a file asks for."""
    cdr = codec.encode("geometry_msgs/msg/WrenchStamped", {})
    content = record_header(1, len(cdr), 0, 1) + cdr
    for message in ("geometry_msgs/msg/WrenchStamped", "x"):
        write(folder / "warm.mcap", [chunk(content, len(content), "")], message)
        outcome(folder / "warm.mcap")


_SLOW = ("many_large_chunks", "window_of_gigabytes")


@pytest.mark.parametrize(
    ("make", "is_read"),
    [pytest.param(*of, id=name, marks=[pytest.mark.slow] if name in _SLOW else []) for name, of in FILES.items()],
)
def test_memory_stays_bounded(tmp_path: Path, make: Callable[[Path], None], is_read: bool):
    path = tmp_path / "hostile.mcap"
    make(path)
    assert path.stat().st_size < 4 * MIB
    ran = subprocess.run(
        [sys.executable, __file__, str(path)], capture_output=True, text=True, check=False, timeout=300
    )
    assert ran.returncode == 0, ran.stderr[-3000:]
    found = json.loads(ran.stdout)
    assert found["grown"] < MOST_BYTES, found
    assert all(len(text) < 400 and "\n" not in text for text in found["said"])
    if is_read:
        assert found["said"] == []
        assert found["held"] > 200 * MIB
    else:
        assert len(found["said"]) >= 2, found
        assert all("hostile.mcap" in text for text in found["said"])


if __name__ == "__main__":
    hostile = Path(sys.argv[1])
    warm_up(hostile.parent)
    sys.stdout.write(json.dumps(outcome(hostile)))
