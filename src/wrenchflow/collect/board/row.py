"""What a control loop tells a board, twenty times a second: a row in a ring, which costs it microseconds."""

import numpy as np
from jaxtyping import Float

from wrenchflow.collect.devices.device import HasSpeeds, TeleopDevice
from wrenchflow.recording.ring import Ring

EVERY_TICKS = 50
ROWS_WAITING = 64  # Three seconds; what comes then is dropped.
_TEXT_BYTES, _NAME_BYTES = 160, 8

ROW = np.dtype(
    [
        ("tick", "i8"),
        ("late", "i8"),  # ticks that began more than a millisecond late
        ("lost", "i8"),  # rows that the recorder had no room for
        ("mode", "i8"),  # of the safety layer
        ("wrench", "f8", 6),  # that it feels, base axes [N, N.m]
        ("tcp_pose", "f8", 7),  # measured, T_base_tcp
        ("goal_pose", "f8", 7),  # as it is perceived; zeros before it is
        ("speed_share", "f8"),  # of full speed, at full deflection
        ("speed_name", "S", _NAME_BYTES),  # of the one that is chosen, where there are several
        ("is_under_way", "i8"),  # 0 during the tare
        ("phase", "i8"),  # of the task, or -1
        ("buttons", "i8"),
        ("elapsed_s", "f8"),
        ("problem", "S", _TEXT_BYTES),  # why the arm does not follow its device
    ],
    align=True,
)


class Feed:
    """The control loop's end."""

    def __init__(self, ring: Ring) -> None:
        """Take a ring of `ROW`."""
        self._ring, self._row = ring, np.zeros(1, ROW)
        self._row["phase"], self._row["speed_share"] = -1, 1.0
        self._speeds: HasSpeeds | None = None

    def aim(self, goal_pose: Float[np.ndarray, " 7"], device: TeleopDevice | None) -> None:
        """What a person needs to know who steers.

        Args:
            goal_pose: The goal as it is perceived, T_base_goal. Shape (7,).
            device: What they steer with.
        """
        self._row["goal_pose"] = goal_pose
        self._speeds = device if isinstance(device, HasSpeeds) else None

    def note(self, *, phase: int, buttons: int, elapsed_s: float, problem: str) -> None:
        """What a period was like; it goes along with the next row."""
        row = self._row[0]
        row["is_under_way"], row["phase"], row["buttons"], row["elapsed_s"] = 1, phase, buttons, elapsed_s
        row["problem"] = problem.encode()[:_TEXT_BYTES]
        if self._speeds is not None:
            name, row["speed_share"] = self._speeds.speed
            row["speed_name"] = name.encode()[:_NAME_BYTES]

    def tick(self, tick: int, late: int, lost: int, ctl: np.ndarray, tcp_pose: Float[np.ndarray, " 7"]) -> None:
        """A tick is over; most are not told.

        Args:
            tick: How many there have been.
            late: How many of them were late.
            lost: Rows that were not recorded.
            ctl: The safety layer's `CTL` record.
            tcp_pose: As it is measured, T_base_tcp. Shape (7,).
        """
        if tick % EVERY_TICKS:
            return
        row, state = self._row[0], ctl[0]
        row["tick"], row["late"], row["lost"], row["mode"] = tick, late, lost, state["mode"]
        row["wrench"], row["tcp_pose"] = state["wrench"], tcp_pose
        self._ring.push(self._row)
