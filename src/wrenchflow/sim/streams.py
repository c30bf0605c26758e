"""From the rows of a plant to the streams of an episode, each with the stamp of when it was sampled."""

import numpy as np

from wrenchflow import signals
from wrenchflow.episode import Stream
from wrenchflow.errors import StreamError
from wrenchflow.sim.engine import TICK_NS
from wrenchflow.sim.row import ROW
from wrenchflow.source import Column, Source

# Forces belong to the tick before their row, and are stamped so.
COLUMNS = (
    Column(name="joint_states", signal=signals.JOINTS),
    Column(name="joint_command", signal=signals.JOINT_TORQUE),
    Column(name="tcp_pose", signal=signals.POSE, frame="base"),
    Column(name="tcp_twist", signal=signals.TWIST, frame="base"),
    Column(name="target_pose", signal=signals.POSE, frame="base"),
    Column(name="command_pose", signal=signals.POSE, frame="base"),
    Column(name="impedance", signal=signals.IMPEDANCE, frame="base"),
    Column(name="request", signal=signals.REQUEST, frame="base"),
    Column(name="governor", signal=signals.GOVERNOR, frame="base"),
    Column(name="external_torque", signal=signals.JOINT_TORQUE, lag_ns=TICK_NS),
    Column(name="wrench_raw", signal=signals.WRENCH, frame="sensor", lag_ns=TICK_NS),
)

# A row of the simulated arm, for who records rows as they are.
ROWS = Source(name="plant", dtype=ROW, columns=COLUMNS)


def streams_of(rows: np.ndarray) -> dict[str, Stream]:
    """Streams by name of rows of dtype `ROW`, in order; the first row's forces have no tick and are left out."""
    if len(rows) < 2:
        raise StreamError(f"a recording needs at least 2 rows, got {len(rows)}.")
    streams = {}
    for column in COLUMNS:
        kept = rows[1:] if column.lag_ns else rows
        streams[column.name] = Stream(
            kept["t_ns"] - column.lag_ns, kept[column.name].copy(), column.signal, column.frame
        )
    return streams
