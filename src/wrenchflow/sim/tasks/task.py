"""What a contact task is: a scene that it adds to the arm, a draw of it, and when it has been done."""

from dataclasses import dataclass
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


def mjcf_of(task: "Task", rig: Rig) -> str:
    """The same as MuJoCo's XML, for people, other tools and pictures; its numbers have six digits."""
    spec = task.make_spec(rig)
    spec.compile()
    return spec.to_xml()


@runtime_checkable
class Task(Protocol):
    """A contact task in simulation."""

    @property
    def name(self) -> str:
        """Name of the task, as the command line takes it."""
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

    def progress(self, scene: Scene, T_base_tcp: Float[np.ndarray, " 7"]) -> float:
        """How far the task is done at a true TCP pose, from 0 to 1; 1 is success."""
        ...

    def failure(self, scene: Scene, T_base_tcp: Float[np.ndarray, " 7"]) -> str:
        """Name of the failure when time has run out at a true TCP pose."""
        ...
