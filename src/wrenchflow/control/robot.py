"""What control asks of an arm, simulated or real."""

from typing import Protocol, runtime_checkable

import numpy as np


@runtime_checkable
class Robot(Protocol):
    """An arm that takes joint torque a thousand times a second.

    Attributes:
        adds_gravity: The hardware (or the simulator) adds gravity compensation by itself. libfranka does.
        adds_friction: The hardware adds joint friction compensation by itself.

    Commanded torque is always without what the robot says that it adds.
    """

    adds_gravity: bool
    adds_friction: bool

    def read(self, obs: np.ndarray) -> None:
        """Fill the one record of `obs` (dtype `OBS`) with this tick's state; waits for the tick on real hardware."""
        ...

    def write(self, tau: np.ndarray) -> None:
        """Command joint torque [N.m], without gravity. Shape (7,)."""
        ...
