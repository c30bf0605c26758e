"""What a policy sees and does at one step: sampled in the same way from a recording and from a running robot."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from jaxtyping import Float32, Int64

from wrenchflow.errors import DatasetError

# The observations of a step, by name, with the shape of one step's value. All are in the base frame and SI units.
OBSERVATIONS: Mapping[str, tuple[int, ...]] = MappingProxyType(
    {
        "tcp_pose": (7,),  # x y z [m], qw qx qy qz: between the two nearest samples
        "tcp_twist": (6,),  # [m/s, rad/s]: between the two nearest samples
        "joint_position": (7,),  # [rad]: between the two nearest samples
        "joint_velocity": (7,),  # [rad/s]: between the two nearest samples
        "wrench": (6,),  # [N, N.m] about the TCP: the last causally filtered sample
        "wrench_mean": (6,),  # the mean of the filtered samples of the last 100 ms
        "wrench_window": (50, 6),  # the last 50 filtered samples, oldest first
        "goal_pose": (7,),  # the task's goal as perceived: held since it was last said
    }
)
ACTION_WIDTH = 9  # target position [m] and first two columns of the target's rotation, in the base frame


@dataclass(frozen=True, eq=False)
class Steps:
    """One episode on the policy's grid: step k is seen at t[k], and its action is the target to be reached at t[k + 1].

    Attributes:
        episode_id: Id of the recording that the steps come from.
        t: Stamps of the steps [ns]. Shape (T,).
        period_ns: Time between steps [ns].
        observations: By name; `OBSERVATIONS` gives shapes and units. Shape (T, ...).
        actions: Target position [m] and rot6d. Shape (T, 9).
    """

    episode_id: str
    t: Int64[np.ndarray, " T"]
    period_ns: int
    observations: Mapping[str, Float32[np.ndarray, "T ..."]]
    actions: Float32[np.ndarray, "T 9"]

    def __post_init__(self) -> None:
        for name, values in self.observations.items():
            if len(values) != len(self.t):
                raise DatasetError(
                    f"observation '{name}' of {self.episode_id} has {len(values)} steps, expected {len(self.t)}."
                )
        if len(self.actions) != len(self.t):
            raise DatasetError(
                f"episode {self.episode_id} has {len(self.actions)} actions, expected {len(self.t)}, one a step."
            )

    def __len__(self) -> int:
        return len(self.t)
