"""Writing a 60 s episode to MCAP: our block writer against the `mcap` package with hand-packed messages.

Both sides make CDR from the same numpy arrays, compress with the same zstd level 1, compute the checksum of each chunk
and leave a closed file that is on the disk. Run it as `python benchmarks/mcap_write.py`.
"""

import os
import struct
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from unittest.mock import patch

import numpy as np
from mcap.writer import Writer

from wrenchflow.episode import Episode, Stream
from wrenchflow.recording import codec, schemas
from wrenchflow.recording.compression import compressor
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode
from wrenchflow.signals import JOINTS, POSE, WRENCH, Signal

DURATION_S = 60.0
RATE_HZ = 1000
REPEATS = 9


def episode(duration_s: float) -> Episode:
    """Joint states, pose and wrench at 1 kHz and a commanded pose at 200 Hz: random walks of unrounded numbers."""
    rng = np.random.default_rng(0)
    n = int(duration_s * RATE_HZ)
    t = 1_700_000_000_000_000_000 + np.arange(n) * (1_000_000_000 // RATE_HZ)

    def stream(signal: Signal, frame: str, every: int = 1) -> Stream:
        rows = np.cumsum(rng.normal(0.0, 1e-3, (n, signal.width)), axis=0)
        return Stream(t[::every], np.ascontiguousarray(rows[::every]), signal, frame)

    streams = {
        "joint_states": stream(JOINTS, "base"),
        "tcp_pose": stream(POSE, "base"),
        "wrench_raw": stream(WRENCH, "sensor"),
        "command_pose": stream(POSE, "base", every=5),
    }
    return Episode("bench", "none", streams)


def n_messages(episode: Episode) -> int:
    """Messages of all topics."""
    return sum(map(len, episode.streams.values()))


def packer(stream: Stream) -> Callable[[int, list[float]], bytes]:
    """A function that packs one message, with all that is constant prepared, as a careful user would write it."""
    signal = stream.signal
    message = schemas.message_of(signal)
    blank = codec.encode(message, schemas.blank_message(signal, stream.frame))
    first = codec.decode(message, blank)[schemas.column_paths(signal)[0]].offset
    constant = blank[12:first]
    stamp = struct.Struct("<4sII")
    if signal.kind == "joints":
        values = struct.Struct("<7dI4x7dI4x7d")
        return lambda t, row: b"".join(
            (
                stamp.pack(b"\0\1\0\0", *divmod(t, 1_000_000_000)),
                constant,
                values.pack(*row[:7], 7, *row[7:14], 7, *row[14:]),
            )
        )
    values = struct.Struct(f"<{signal.width}d")
    order = [0, 1, 2, 4, 5, 6, 3] if signal.kind == "pose" else range(signal.width)
    return lambda t, row: (
        stamp.pack(b"\0\1\0\0", *divmod(t, 1_000_000_000)) + constant + values.pack(*[row[i] for i in order])
    )


def in_order_of_time(episode: Episode) -> list[tuple[int, str, int]]:
    """Time, stream and row of every sample."""
    samples: Iterator[tuple[int, str, int]] = (
        (t, name, row) for name, stream in episode.streams.items() for row, t in enumerate(stream.t.tolist())
    )
    return sorted(samples, key=lambda sample: sample[0])


def write_with_mcap(path: Path, episode: Episode, samples: list[tuple[int, str, int]]) -> None:
    """One `add_message` a sample, in the order of time."""
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2")
        channels, packers = {}, {}
        for name, stream in episode.streams.items():
            message = schemas.message_of(stream.signal)
            schema = writer.register_schema(message, "ros2msg", schemas.definition(message).encode())
            channels[name] = writer.register_channel(f"/{name}", "cdr", schema)
            packers[name] = packer(stream)
        rows = {name: stream.data for name, stream in episode.streams.items()}
        for t, name, row in samples:
            writer.add_message(channels[name], t, packers[name](t, rows[name][row].tolist()), t, row)
        writer.finish()
        file.flush()
        os.fsync(file.fileno())


def wall_s(work: Callable[[], object]) -> float:
    """Wall time of one call [s]."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def main() -> None:
    """Measure both sides in turn and print them."""
    whole = episode(DURATION_S)
    samples = in_order_of_time(whole)
    ours_s, theirs_s = [], []
    ours_bytes = theirs_bytes = 0
    with tempfile.TemporaryDirectory() as folder, patch("mcap.writer.zstandard.compress", compressor("zstd")):
        ours, theirs = Path(folder, "ours.mcap"), Path(folder, "theirs.mcap")
        for repeat in range(REPEATS + 1):  # The first round warms up, and compares.
            times = wall_s(lambda: write_episode(ours, whole)), wall_s(lambda: write_with_mcap(theirs, whole, samples))
            if repeat:
                ours_s.append(times[0])
                theirs_s.append(times[1])
            elif read_episode(ours) != whole or read_episode(theirs).streams != whole.streams:
                raise SystemExit("the two sides did not write the same values.")
            ours_bytes, theirs_bytes = ours.stat().st_size, theirs.stat().st_size
            ours.unlink()
            theirs.unlink()
    n = n_messages(whole)
    print(f"{n} messages, {DURATION_S:.0f} s of robot time, one zstd level 1 compressor for both, median of {REPEATS}")
    for name, took, size in (("wrenchflow", ours_s, ours_bytes), ("mcap", theirs_s, theirs_bytes)):
        print(
            f"{name:12} {median(took):7.3f} s  {n / median(took) / 1000:7.0f} thousand messages/s  {size / 1e6:6.1f} MB"
        )
    ratios = sorted(b / a for a, b in zip(ours_s, theirs_s, strict=True))
    print(f"ratio        {median(ratios):7.1f}x  ({ratios[0]:.1f} to {ratios[-1]:.1f} in paired runs; goal 8x)")


if __name__ == "__main__":
    main()
