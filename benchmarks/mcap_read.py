"""Reading a 60 s episode to numpy: our vectorised reader against `mcap-ros2-support`.

Both sides end with the same arrays (time stamps and float64 rows of each topic). Run it as
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
from wrenchflow.recording.container import Container
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode

SLICE_S = 4.0  # The slow side reads this much, and its time is scaled by the number of messages.
REPEATS = 5


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


def decompress(path: Path) -> int:
    """Only read, decompress and check the chunks: the floor for any reader."""
    container = Container(path)
    container.check()
    return sum(len(container.unpack(chunk)) for chunk in container.chunks)


def equal(streams: dict[str, tuple[np.ndarray, np.ndarray]], expected: Episode) -> bool:
    """Whether the other side found the same stamps and rows."""
    return all(Stream(*streams[name], s.signal, s.frame) == s for name, s in expected.streams.items())


def main() -> None:
    """Measure both sides in turn and print them."""
    whole, part = episode(DURATION_S), episode(SLICE_S)
    scale = n_messages(whole) / n_messages(part)
    ours_s, floor_s, theirs_s = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        long, short = Path(folder, "long.mcap"), Path(folder, "short.mcap")
        write_episode(long, whole)
        write_episode(short, part)
        if read_episode(long) != whole or not equal(read_with_mcap_ros2(short), part):
            raise SystemExit("the two sides did not read the same values.")
        for repeat in range(REPEATS + 1):  # The first round warms up.
            times = (
                wall_s(lambda: read_episode(long)),
                wall_s(lambda: decompress(long)),
                wall_s(lambda: read_with_mcap_ros2(short)) * scale,
            )
            if repeat:
                for took, time_s in zip((ours_s, floor_s, theirs_s), times, strict=True):
                    took.append(time_s)
    print(f"{n_messages(whole)} messages, {DURATION_S:.0f} s of robot time, median of {REPEATS}")
    print(f"(mcap-ros2-support read {SLICE_S:.0f} s; its time is scaled by the number of messages)")
    for name, took in (("decompress only", floor_s), ("wrenchflow", ours_s), ("mcap-ros2-support", theirs_s)):
        print(f"{name:18} {median(took):7.3f} s")
    print(f"ratio              {median(theirs_s) / median(ours_s):7.1f}x  (goal 50x)")
    print(f"over the floor     {median(ours_s) / median(floor_s):7.1f}x")


if __name__ == "__main__":
    main()
