"""What happened in a run, tick by tick: what was asked and remembered, and what was true in the simulator meanwhile."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from wrenchflow.control.records import CTL, JOINTS, OBS, REQ

# What MuJoCo says, and no controller knows. Base axes; forces are those that the robot exerts.
TRUTH = np.dtype(
    [
        ("q", "f8", JOINTS),  # when the torque was decided [rad]
        ("dq", "f8", JOINTS),
        ("q_after", "f8", JOINTS),  # when it had acted for a tick
        ("dq_after", "f8", JOINTS),
        ("x", "f8", 3),  # of the TCP [m]
        ("R", "f8", (3, 3)),
        ("J", "f8", (6, JOINTS)),
        ("M", "f8", (JOINTS, JOINTS)),
        ("contact", "f8", 3),  # on all that the tool touches, mean of the tick [N]
        ("elsewhere", "f8", 3),  # on what the links touch [N]
        ("constraint", "f8", JOINTS),  # joint torque of contacts and ends on the robot, mean of the tick [N.m]
        ("hand", "f8", 3),  # what somebody exerts on the robot [N]
        ("hand_moment", "f8", 3),  # [N.m]
        ("contacts", "i8"),
        ("tampered", "?"),  # what the controller saw was not what the robot had measured
    ],
    align=True,
)


@dataclass(frozen=True)
class Trace:
    """One run; all arrays have a row a tick.

    Attributes:
        obs: What the controller saw. Dtype `OBS`.
        req: What it was asked. Dtype `REQ`.
        before: Its state before the tick. Dtype `CTL`.
        after: Its state after the tick. Dtype `CTL`.
        truth: What was so. Dtype `TRUTH`.
    """

    obs: np.ndarray
    req: np.ndarray
    before: np.ndarray
    after: np.ndarray
    truth: np.ndarray

    def __len__(self) -> int:
        return len(self.obs)

    def part(self, start: int, stop: int) -> "Trace":
        """The ticks from `start` to before `stop`."""
        return Trace(*(each[start:stop] for each in (self.obs, self.req, self.before, self.after, self.truth)))

    @cached_property
    def twist(self) -> np.ndarray:
        """True twist of the TCP when the torque was decided [m/s, rad/s]. Shape (n, 6)."""
        return np.einsum("naj,nj->na", self.truth["J"], self.truth["dq"])

    @cached_property
    def kinetic(self) -> np.ndarray:
        """True kinetic energy when the torque was decided, rotors included [J]. Shape (n,)."""
        return 0.5 * np.einsum("ni,nij,nj->n", self.truth["dq"], self.truth["M"], self.truth["dq"])

    @cached_property
    def work(self) -> np.ndarray:
        """Work of each tick's torque on the true arm [J]. Shape (n,)."""
        return ((self.truth["q_after"] - self.truth["q"]) * self.after["tau"]).sum(1)

    @cached_property
    def is_pushed(self) -> np.ndarray:
        """Whether somebody pushed, at each tick. Shape (n,)."""
        return (self.truth["hand"] != 0.0).any(1) | (self.truth["hand_moment"] != 0.0).any(1)

    @cached_property
    def is_free(self) -> np.ndarray:
        """Whether nothing was touched and nobody pushed, at each tick. Shape (n,)."""
        return (self.truth["contacts"] == 0) & ~self.is_pushed


class Log:
    """Room for a trace, filled a tick at a time; raw bytes, for numpy copies a record of many fields slowly."""

    def __init__(self) -> None:
        self.count = 0
        self.arrays = tuple(np.zeros(0, dtype) for dtype in (OBS, REQ, CTL, CTL, TRUTH))

    def make_room(self, ticks: int) -> None:
        """For so many ticks more."""
        missing = self.count + ticks - len(self.arrays[0])
        if missing > 0:
            self.arrays = tuple(_longer(each, max(missing, len(each))) for each in self.arrays)

    @property
    def bytes(self) -> tuple[np.ndarray, ...]:
        """Views of observation, request and the state before and after, a row of bytes a tick."""
        return tuple(each.view(np.uint8).reshape(len(each), -1) for each in self.arrays[:4])

    @property
    def truth(self) -> dict[str, np.ndarray]:
        """Views of what was so, by name."""
        return {name: self.arrays[4][name] for name in TRUTH.names}

    @property
    def trace(self) -> Trace:
        """All so far, as views."""
        return Trace(*(each[: self.count] for each in self.arrays))


def _longer(array: np.ndarray, by: int) -> np.ndarray:
    longer = np.zeros(len(array) + by, array.dtype)
    longer.view(np.uint8)[: array.nbytes] = array.view(np.uint8)
    return longer
