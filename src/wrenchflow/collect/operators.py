"""What an operator is: somebody who sees and feels, and wants the target somewhere."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, kw_only=True, eq=False)
class Perception:
    """What a person at the arm could know; nothing of the simulator's truth.

    Attributes:
        t_s: Time since control was handed over [s].
        tcp_pose: Measured T_base_tcp. Shape (7,).
        goal_pose: The goal as perceived, T_base_goal. Shape (7,).
        wrench: Causally filtered wrench about the TCP, base axes [N, N.m]. Shape (6,).
        wrench_mean: Its mean over the last 100 ms. Shape (6,).
    """

    t_s: float
    tcp_pose: Float[np.ndarray, " 7"]
    goal_pose: Float[np.ndarray, " 7"]
    wrench: Float[np.ndarray, " 6"]
    wrench_mean: Float[np.ndarray, " 6"]


@runtime_checkable
class Operator(Protocol):
    """Decides where the target should be, two hundred times a second."""

    def want(self, perception: Perception) -> tuple[Float[np.ndarray, " 7"], str]:
        """The wanted target pose, and the name of the phase that the operator thinks to be in."""
        ...
