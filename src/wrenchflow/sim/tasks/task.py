"""What a contact task is: a scene that it adds to the arm, a draw of it, and who says when it has been done."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol, runtime_checkable

import mujoco
import numpy as np
from jaxtyping import Float

from wrenchflow.rig import Rig


@dataclass(frozen=True, kw_only=True)
class Scene:
    """One draw of a task: what is so, and what is believed.

    Attributes:
        q_start_rad: Joints at the start. Shape (7,).
        T_base_goal: The true goal, hidden from operator and policy.
        T_base_goal_perceived: The goal as perceived.
    """

    q_start_rad: Float[np.ndarray, " 7"]
    T_base_goal: Float[np.ndarray, " 7"]
    T_base_goal_perceived: Float[np.ndarray, " 7"]


def make_model(task: "Task", rig: Rig) -> mujoco.MjModel:
    """The model of a task with the arm of `rig`."""
    return task.make_spec(rig).compile()


@lru_cache(maxsize=4)
def mjcf_of(task: "Task", rig: Rig) -> str:
    """The same as MuJoCo's XML, for people, other tools and pictures; its numbers have six digits."""
    spec = task.make_spec(rig)
    spec.compile()
    return spec.to_xml()


@runtime_checkable
class Referee(Protocol):
    """Watches one attempt, by what is true and not by what is measured, and says how it stands."""

    def see(self, T_base_tcp: Float[np.ndarray, "n 7"], wrench: Float[np.ndarray, "n 6"]) -> None:
        """Take in what has happened, two hundred times a second.

        Args:
            T_base_tcp: True TCP poses. Shape (n, 7).
            wrench: What the tool exerts, tared and low-passed at 50 Hz, about the TCP in base axes [N, N.m]. Shape
                (n, 6).
        """
        ...

    @property
    def progress(self) -> float:
        """How far the task is done, from 0 to 1; 1 is success."""
        ...

    @property
    def failure(self) -> str:
        """What the attempt has failed by, if it ends now without success; one of the task's `failures`."""
        ...

    @property
    def is_lost(self) -> bool:
        """Whether it cannot succeed any more, so that there is no use in going on."""
        ...


@runtime_checkable
class Task(Protocol):
    """A contact task in simulation."""

    @property
    def name(self) -> str:
        """Name of the task, as the command line takes it."""
        ...

    @property
    def rig(self) -> str:
        """Name of the rig that holds the task's tool, where nobody names another."""
        ...

    @property
    def phases(self) -> tuple[str, ...]:
        """What is done one after the other, some of it perhaps again; operators number their phases by these."""
        ...

    @property
    def failures(self) -> tuple[str, ...]:
        """All that an attempt can fail by."""
        ...

    @property
    def force_limit_n(self) -> float:
        """Low-passed force from which on the work is spoilt, or was not done well [N]; people are shown it."""
        ...

    @property
    def time_limit_s(self) -> float:
        """How long an attempt may last [s]."""
        ...

    def make_spec(self, rig: Rig) -> mujoco.MjSpec:
        """The arm of `rig` with the task's tool and fixture."""
        ...

    def draw(self, model: mujoco.MjModel, rng: np.random.Generator) -> Scene:
        """Draw a scene."""
        ...

    def place(self, model: mujoco.MjModel, data: mujoco.MjData, scene: Scene) -> None:
        """Set `data` to the start of a scene."""
        ...

    def contact_zone(self, scene: Scene) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"]]:
        """Where contact is expected: the lowest and the highest corner of a box in the base frame, where the reference
        is slow. It knows what is perceived, not what is so.
        """
        ...

    def referee(self, scene: Scene) -> Referee:
        """Who judges one attempt at a scene."""
        ...
