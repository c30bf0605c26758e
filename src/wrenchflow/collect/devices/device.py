"""What a teleoperation device is: read without waiting, honest about when it last spoke, and felt where it can be."""

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int64

# Which bit of `Reading.buttons` is what, whatever the device's own numbers are.
GRIPPER_BUTTON, MARK_BUTTON = 0, 1


@dataclass(frozen=True, kw_only=True, eq=False)
class Reading:
    """What a device said last.

    Attributes:
        t_ns: When its newest sound report came, on the clock that `read` was told the time of; 0 before the first.
        counts: Its axes x y z rx ry rz as it reports them, whole numbers up to its `full_scale_counts`. Shape (6,).
        buttons: Pressed ones, a bit each: bit 0 is the gripper's, bit 1 marks a moment.
        pose: Where the TCP should be, T_base_tcp, of devices that say where and not how fast; then counts are zeros.
            Shape (7,).
        problem: Why the arm must not follow this, in a few words; empty where all is well.
    """

    t_ns: int
    counts: Int64[np.ndarray, " 6"] = field(default_factory=lambda: np.zeros(6, np.int64))
    buttons: int = 0
    pose: Float[np.ndarray, " 7"] | None = None
    problem: str = ""


@runtime_checkable
class HasSpeeds(Protocol):
    """A device whose full deflection is one of several speeds."""

    @property
    def speed(self) -> tuple[str, float]:
        """Name of the one that is chosen, and its share of full speed."""
        ...

    def slow_down(self) -> None:
        """Choose the slowest: an attempt begins."""
        ...


@runtime_checkable
class TeleopDevice(Protocol):
    """Something that a person moves an arm with.

    What a device says never reaches the arm by itself: `collect.follow` turns it into a twist of the target, which the
    control core then limits.
    """

    @property
    def name(self) -> str:
        """As the command line takes it, for the metadata."""
        ...

    @property
    def full_scale_counts(self) -> int:
        """What an axis reports at full deflection."""
        ...

    def read(self, now_ns: int) -> Reading:
        """Take in all reports that wait, and say the newest; never waits.

        Args:
            now_ns: The time now, on whatever clock the session runs by; it stamps reports that have no stamp.

        Raises:
            DeviceError: If the device has gone; the message says what to do.
        """
        ...

    def feel(self, share: float) -> None:
        """Let the hand feel how hard the tool presses, from 0 to 1 (rumble); does nothing where a device cannot."""
        ...

    def close(self) -> None:
        """Let go of the device; may be called twice."""
        ...
