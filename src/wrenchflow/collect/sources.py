"""What a demonstration by the clock records: the control loop's rows, the device's reports, and the goal."""

from dataclasses import replace

import numpy as np

from wrenchflow import signals
from wrenchflow.sim.row import ROW
from wrenchflow.sim.streams import COLUMNS
from wrenchflow.source import Column, Source

_TIMES = [("t_ns", "i8"), ("received_ns", "i8"), ("sequence", "i8")]
CONTROL = Source(
    name="control",
    dtype=np.dtype([*_TIMES, *((column.name, ROW[column.name]) for column in COLUMNS)], align=True),
    columns=COLUMNS,
)
DEVICE = Source(
    name="device",
    dtype=np.dtype([*_TIMES, ("teleop/joy", "f8", (8,)), ("teleop/twist", "f8", (6,))], align=True),
    columns=(
        Column(name="teleop/joy", signal=signals.JOY, frame="device"),
        Column(name="teleop/twist", signal=signals.TWIST, frame="base"),
    ),
)
GOAL = Source(
    name="goal",
    dtype=np.dtype([*_TIMES, ("goal_pose", "f8", (7,))], align=True),
    columns=(Column(name="goal_pose", signal=signals.POSE, frame="base"),),
    capacity=16,
)


def with_looks(size: int) -> Source:
    """The control loop's source where there are cameras: its rows also say what the scene looks like."""
    fields = [(name, CONTROL.dtype[name]) for name in CONTROL.dtype.names or ()]
    return replace(CONTROL, dtype=np.dtype([*fields, ("looks", "f8", (size,))], align=True))
