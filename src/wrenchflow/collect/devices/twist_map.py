"""How a device's axes become a twist of the target, as a person sets it; `collect.follow` does it."""

from dataclasses import dataclass
from typing import Literal

from wrenchflow.config import require_between
from wrenchflow.errors import ConfigError

Axis = Literal["x", "y", "z", "rx", "ry", "rz", "-x", "-y", "-z", "-rx", "-ry", "-rz"]
AXES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True, kw_only=True)
class TwistMap:
    """From axis counts to a twist of the target in the base frame.

    Attributes:
        deadzone: Share of the full scale in which a resting hand moves nothing; past it speed grows from zero.
        linear_max_m_s: Speed at full deflection [m/s].
        angular_max_rad_s: The same for turning [rad/s].
        axes: Which of the device's axes moves x y z rx ry rz of the target, with a minus to turn it round; the usual
            order is for a person who stands behind the arm.
        dead_man_s: A device that is deflected and says nothing for so long moves nothing any more [s].
    """

    deadzone: float = 0.05
    linear_max_m_s: float = 0.20
    angular_max_rad_s: float = 0.8
    axes: tuple[Axis, Axis, Axis, Axis, Axis, Axis] = ("x", "y", "z", "rx", "ry", "rz")
    dead_man_s: float = 0.1

    def __post_init__(self) -> None:
        if not 0.0 <= self.deadzone < 1.0:
            raise ConfigError(f"a twist map takes a deadzone from 0 to below 1, got {self.deadzone:g}.")
        # As far as `control.speed_max_m_s` and `control.turn_max_rad_s` go: no target may be faster anyway.
        require_between(0.001, 3.0, **{"twist_map.linear_max_m_s": self.linear_max_m_s})
        require_between(0.005, 4.0, **{"twist_map.angular_max_rad_s": self.angular_max_rad_s})
        # A device that is gone for longer is no device that a person stands beside and waits for.
        require_between(0.005, 1.0, **{"twist_map.dead_man_s": self.dead_man_s})
        if sorted(self.axis_numbers) != list(range(6)):
            raise ConfigError(f"a twist map takes each of {', '.join(AXES)} once, got {', '.join(self.axes)}.")

    @property
    def axis_numbers(self) -> list[int]:
        """Number of the device's axis that moves axis i of the twist."""
        return [AXES.index(axis.removeprefix("-")) for axis in self.axes]

    @property
    def axis_signs(self) -> list[float]:
        """1 or -1 each."""
        return [-1.0 if axis.startswith("-") else 1.0 for axis in self.axes]
