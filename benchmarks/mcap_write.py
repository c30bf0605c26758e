"""Writing a 60 s episode to MCAP, at once and row by row, against the writers that a careful user would take.

At once: our block writer against the `mcap` package with hand-packed messages. Row by row: our `Recorder`, which is
given one row a tick as fast as it takes them, against `foxglove-sdk` and `mcap` with hand-packed messages and
`mcap-ros2-support`. All sides make CDR from the same numpy arrays, compress with zstd level 1, compute the checksum of
each chunk and leave a closed file that is on the disk; all are read back. Run it as `python benchmarks/mcap_write.py`.
"""

import os
import struct
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median
from unittest.mock import patch

import foxglove
import numpy as np
from foxglove.mcap import MCAPWriteOptions
from mcap.writer import Writer
from mcap_ros2.writer import Writer as Ros2Writer

from wrenchflow.episode import Episode, Stream
from wrenchflow.recording import codec, schemas
from wrenchflow.recording.compression import compressor
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.recorder import Recorder
from wrenchflow.recording.write import write_episode
from wrenchflow.signals import JOINTS, POSE, WRENCH, Signal
from wrenchflow.source import Column, Source

DURATION_S = 60.0
RATE_HZ = 1000
REPEATS = 9
ROW_REPEATS = 5
SLICE_S = 4.0  # The slowest side writes this much, and its time is scaled by the number of messages.
S = 1_000_000_000


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


def write_with_foxglove(path: Path, episode: Episode, samples: list[tuple[int, str, int]]) -> None:
    """One `log` a sample, in the order of time."""
    context = foxglove.Context()
    options = MCAPWriteOptions(compression_level=1)
    channels, packers = {}, {}
    with foxglove.open_mcap(path, context=context, writer_options=options):
        for name, stream in episode.streams.items():
            message = schemas.message_of(stream.signal)
            text = schemas.definition(message).encode()
            schema = foxglove.Schema(name=message, encoding="ros2msg", data=text)
            channels[name] = foxglove.Channel(f"/{name}", schema=schema, message_encoding="cdr", context=context)
            packers[name] = packer(stream)
        rows = {name: stream.data for name, stream in episode.streams.items()}
        for t, name, row in samples:
            channels[name].log(packers[name](t, rows[name][row].tolist()), log_time=t)
    sync(path)


def write_with_mcap_ros2(path: Path, episode: Episode, samples: list[tuple[int, str, int]]) -> None:
    """One dictionary a sample, in the order of time."""
    with path.open("wb") as file:
        writer = Ros2Writer(file)
        definitions = {}
        for name, stream in episode.streams.items():
            message = schemas.message_of(stream.signal)
            definitions[name] = writer.register_msgdef(message, schemas.definition(message))
        names = [f"panda_joint{i + 1}" for i in range(7)]
        for t, name, row in samples:
            stream = episode.streams[name]
            header = {"stamp": dict(zip(("sec", "nanosec"), divmod(t, S), strict=True)), "frame_id": stream.frame}
            v = stream.data[row].tolist()
            match stream.signal.kind:
                case "joints":
                    message = {"name": names, "position": v[:7], "velocity": v[7:14], "effort": v[14:]}
                case "pose":
                    position = dict(zip("xyz", v, strict=False))
                    message = {"pose": {"position": position, "orientation": dict(zip("wxyz", v[3:], strict=True))}}
                case _:
                    force, torque = dict(zip("xyz", v, strict=False)), dict(zip("xyz", v[3:], strict=True))
                    message = {"wrench": {"force": force, "torque": torque}}
            writer.write_message(f"/{name}", definitions[name], {"header": header, **message}, t, t, row)
        writer.finish()
        file.flush()
        os.fsync(file.fileno())


def sync(path: Path) -> None:
    """Make sure that a file is on the disk."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())


def sources(episode: Episode) -> list[Source]:
    """The streams at 1 kHz as one source, the command at 200 Hz as another."""

    def source(name: str, names: list[str]) -> Source:
        columns = tuple(Column(name=of, signal=episode[of].signal, frame=episode[of].frame) for of in names)
        fields = [("t_ns", "i8"), *((column.name, "f8", (column.signal.width,)) for column in columns)]
        # What waits at most while the writer looks elsewhere.
        return Source(name=name, dtype=np.dtype(fields, align=True), columns=columns, capacity=16384)

    command = ["command_pose"]
    return [source("control", [name for name in episode.streams if name not in command]), source("command", command)]


def write_row_by_row(path: Path, episode: Episode) -> float:
    """Fill and push one row a tick; the time from the first row until the file is closed [s]."""
    control, command = sources(episode)
    row, other = np.zeros(1, control.dtype), np.zeros(1, command.dtype)
    stamps = episode["tcp_pose"].t.tolist()
    states = np.hstack([episode[column.name].data for column in control.columns])
    poses = episode["command_pose"].data
    # The loop's state is one vector, behind the stamp; a row takes it in one assignment.
    row_t, row_state = row.view(np.int64), row.view(np.float64)[1:]
    with Recorder(path, id=episode.id, task=episode.task, sources=[control, command]) as recorder:
        push_row, push_other = recorder.ring("control").push, recorder.ring("command").push
        start = time.perf_counter()
        for i, t in enumerate(stamps):
            row_t[0] = t
            row_state[:] = states[i]
            while not push_row(row):
                time.sleep(0.0005)
            if i % 5 == 0:
                other["t_ns"], other["command_pose"] = t, poses[i // 5]
                while not push_other(other):
                    time.sleep(0.0005)
        recorder.finish()
        return time.perf_counter() - start


def wall_s(work: Callable[[], object]) -> float:
    """Wall time of one call [s]."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def at_once(folder: Path, whole: Episode, samples: list[tuple[int, str, int]]) -> None:
    """Measure block writing, both sides in turn, and print it."""
    ours_s, theirs_s = [], []
    ours_bytes = theirs_bytes = 0
    ours, theirs = folder / "ours.mcap", folder / "theirs.mcap"
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
    print(f"at once, median of {REPEATS}, one compressor for both")
    for name, took, size in (("wrenchflow", ours_s, ours_bytes), ("mcap", theirs_s, theirs_bytes)):
        print(f"  {name:18} {median(took):7.3f} s  {n / median(took) / 1000:6.0f} k messages/s  {size / 1e6:5.1f} MB")
    ratios = sorted(b / a for a, b in zip(ours_s, theirs_s, strict=True))
    print(f"  ratio {median(ratios):.1f}x  ({ratios[0]:.1f} to {ratios[-1]:.1f} in paired runs; goal 8x)")


def row_by_row(folder: Path, whole: Episode, samples: list[tuple[int, str, int]]) -> None:
    """Measure writing row by row, all sides in turn, and print it."""
    part = episode(SLICE_S)
    part_samples, scale = in_order_of_time(part), n_messages(whole) / n_messages(part)
    path = folder / "rows.mcap"
    sides: dict[str, tuple[Callable[[], float], Episode, float | None]] = {
        "wrenchflow": (lambda: write_row_by_row(path, whole), whole, None),
        "foxglove-sdk": (lambda: wall_s(lambda: write_with_foxglove(path, whole, samples)), whole, 5),
        "mcap": (lambda: wall_s(lambda: write_with_mcap(path, whole, samples)), whole, 10),
        "mcap-ros2-support": (
            lambda: wall_s(lambda: write_with_mcap_ros2(path, part, part_samples)) * scale,
            part,
            40,
        ),
    }
    taken_s: dict[str, list[float]] = {name: [] for name in sides}
    sizes: dict[str, float] = {}
    for repeat in range(ROW_REPEATS + 1):  # The first round warms up, and compares.
        for name, (work, expected, _) in sides.items():
            took_s = work()
            if repeat:
                taken_s[name].append(took_s)
            elif read_episode(path).streams != expected.streams:
                raise SystemExit(f"{name} did not write the same values.")
            sizes[name] = path.stat().st_size * (scale if expected is part else 1.0)
            path.unlink()
    n, ours_s = n_messages(whole), median(taken_s["wrenchflow"])
    print(f"row by row, median of {ROW_REPEATS}; from the first row until the file is closed")
    print(f"  (mcap-ros2-support wrote {SLICE_S:.0f} s; its figures are scaled by the number of messages)")
    for name, (_, _, goal) in sides.items():
        took_s = median(taken_s[name])
        said = f"  {took_s / ours_s:5.1f}x ours (goal {goal}x)" if goal else ""
        print(f"  {name:18} {took_s:7.3f} s  {n / took_s / 1000:6.0f} k messages/s  {sizes[name] / 1e6:5.1f} MB{said}")


def main() -> None:
    """Measure and print."""
    whole = episode(DURATION_S)
    samples = in_order_of_time(whole)
    print(f"{n_messages(whole)} messages, {DURATION_S:.0f} s of robot time")
    with tempfile.TemporaryDirectory() as folder, patch("mcap.writer.zstandard.compress", compressor("zstd")):
        at_once(Path(folder), whole, samples)
        row_by_row(Path(folder), whole, samples)


if __name__ == "__main__":
    main()
