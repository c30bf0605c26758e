"""From the rows of a plant to the streams of an episode, each with the stamp of when it was sampled."""

import numpy as np

from wrenchflow import signals
from wrenchflow.episode import Stream
from wrenchflow.errors import StreamError
from wrenchflow.sim.engine import TICK_NS

_SAME_TICK = {
    "joint_states": (signals.JOINTS, ""),
    "joint_command": (signals.JOINT_TORQUE, ""),
    "tcp_pose": (signals.POSE, "base"),
    "tcp_twist": (signals.TWIST, "base"),
    "target_pose": (signals.POSE, "base"),
    "command_pose": (signals.POSE, "base"),
    "impedance": (signals.IMPEDANCE, "base"),
}
_LAST_TICK = {
    "external_torque": (signals.JOINT_TORQUE, ""),
    "wrench_raw": (signals.WRENCH, "sensor"),
}


def streams_of(rows: np.ndarray) -> dict[str, Stream]:
    """Streams by name of rows of dtype `ROW`, in order.

    Forces belong to the tick before their row, and are stamped so; the first row's have no tick and are left out.
    """
    if len(rows) < 2:
        raise StreamError(f"a recording needs at least 2 rows, got {len(rows)}.")
    t = rows["t_ns"].copy()
    streams = {name: Stream(t, rows[name].copy(), signal, frame) for name, (signal, frame) in _SAME_TICK.items()}
    late = {
        name: Stream(t[1:] - TICK_NS, rows[name][1:].copy(), signal, frame)
        for name, (signal, frame) in _LAST_TICK.items()
    }
    return streams | late
