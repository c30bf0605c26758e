"""Reading a 60 s episode to numpy: our reader against the `mcap` package with hand-written decoding, and against
`mcap-ros2-support`.

All sides end with the same arrays (time stamps and float64 rows of each topic). Run it as
`python benchmarks/mcap_read.py`.
"""

import tempfile
from pathlib import Path
from statistics import median

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from mcap_write import DURATION_S, episode, n_messages, wall_s
from wrenchflow.episode import Episode, Stream
from wrenchflow.recording import codec, schemas
from wrenchflow.recording.container import Container
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode

SLICE_S = 4.0  # The slowest side reads this much, and its time is scaled by the number of messages.
REPEATS = 9


def _pose(message) -> tuple[float, ...]:
    p, q = message.pose.position, message.pose.orientation
    return p.x, p.y, p.z, q.w, q.x, q.y, q.z


def _wrench(message) -> tuple[float, ...]:
    f, t = message.wrench.force, message.wrench.torque
    return f.x, f.y, f.z, t.x, t.y, t.z


ROWS = {
    "joint_states": lambda message: (*message.position, *message.velocity, *message.effort),
    "tcp_pose": _pose,
    "command_pose": _pose,
    "wrench_raw": _wrench,
}


def read_with_mcap_ros2(path: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Stamps and rows of each topic, from its decoded messages."""
    stamps: dict[str, list[int]] = {name: [] for name in ROWS}
    rows: dict[str, list[tuple[float, ...]]] = {name: [] for name in ROWS}
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages(topics=[f"/{name}" for name in ROWS]):
            name = channel.topic[1:]
            stamps[name].append(message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec)
            rows[name].append(ROWS[name](message))
    return {name: (np.array(stamps[name]), np.array(rows[name])) for name in ROWS}


def record_dtype(stream: Stream) -> np.dtype:
    """A message of a stream as a careful user would describe it: found once, by a look at one message."""
    message = schemas.message_of(stream.signal)
    blank = codec.encode(message, schemas.blank_message(stream.signal, stream.frame))
    leaves = codec.decode(message, blank)
    paths = ("header.stamp.sec", "header.stamp.nanosec", *schemas.column_paths(stream.signal))
    return np.dtype(
        {
            "names": ["sec", "nanosec", *stream.signal.columns],
            "offsets": [leaves[path].offset for path in paths],
            "formats": [leaves[path].code for path in paths],
            "itemsize": len(blank),
        }
    )


def read_with_mcap(path: Path, dtypes: dict[str, np.dtype]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Stamps and rows of each topic: the messages of each, joined, and looked at as one array."""
    messages: dict[str, list[bytes]] = {name: [] for name in dtypes}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(topics=[f"/{name}" for name in dtypes]):
            messages[channel.topic[1:]].append(message.data)
    found = {}
    for name, dtype in dtypes.items():
        rows = np.frombuffer(b"".join(messages[name]), dtype)
        t = rows["sec"].astype(np.int64) * 1_000_000_000 + rows["nanosec"]
        found[name] = t, np.column_stack([rows[column] for column in (dtype.names or ())[2:]])
    return found


def decompress(path: Path) -> int:
    """Only read, decompress and check every byte: the floor for any reader."""
    container = Container(path)
    container.check()
    return sum(len(container.unpack(chunk)) for chunk in container.chunks)


def equal(streams: dict[str, tuple[np.ndarray, np.ndarray]], expected: Episode) -> bool:
    """Whether the other side found the same stamps and rows."""
    return all(Stream(*streams[name], s.signal, s.frame) == s for name, s in expected.streams.items())


def main() -> None:
    """Measure all sides in turn and print them."""
    whole, part = episode(DURATION_S), episode(SLICE_S)
    scale = n_messages(whole) / n_messages(part)
    dtypes = {name: record_dtype(stream) for name, stream in whole.streams.items()}
    sides = ("decompress only", "wrenchflow", "mcap + frombuffer", "mcap-ros2-support")
    taken_s: dict[str, list[float]] = {name: [] for name in sides}
    with tempfile.TemporaryDirectory() as folder:
        long, short = Path(folder, "long.mcap"), Path(folder, "short.mcap")
        write_episode(long, whole)
        write_episode(short, part)
        are_equal = equal(read_with_mcap(long, dtypes), whole) and equal(read_with_mcap_ros2(short), part)
        if read_episode(long) != whole or not are_equal:
            raise SystemExit("the sides did not read the same values.")
        for repeat in range(REPEATS + 1):  # The first round warms up.
            times = (
                wall_s(lambda: decompress(long)),
                wall_s(lambda: read_episode(long)),
                wall_s(lambda: read_with_mcap(long, dtypes)),
                wall_s(lambda: read_with_mcap_ros2(short)) * scale,
            )
            if repeat:
                for name, time_s in zip(sides, times, strict=True):
                    taken_s[name].append(time_s)
    floor_s, ours_s, *theirs_s = (median(taken_s[name]) for name in sides)
    print(f"{n_messages(whole)} messages, {DURATION_S:.0f} s of robot time, median of {REPEATS}")
    print(f"(mcap-ros2-support read {SLICE_S:.0f} s; its time is scaled by the number of messages)")
    print(f"{sides[0]:18} {floor_s:7.3f} s")
    print(f"{sides[1]:18} {ours_s:7.3f} s  {ours_s / floor_s:5.2f} times the floor (goal: at most 1.6)")
    for name, time_s, goal in zip(sides[2:], theirs_s, (20, 80), strict=True):
        print(f"{name:18} {time_s:7.3f} s  {time_s / ours_s:5.1f}x ours (goal {goal}x)")


if __name__ == "__main__":
    main()
