"""The scripted operator: a task's skill without a person's hand. It sees exactly, feels exactly, and never tires."""

import numpy as np
from jaxtyping import Float

from wrenchflow.collect.operators import Perception
from wrenchflow.collect.skills.decide import skill_of, want
from wrenchflow.collect.skills.goal_axes import perceive_into, target_into
from wrenchflow.collect.skills.skill import PERCEIVED, WANTED
from wrenchflow.control.config import Impedance
from wrenchflow.spatial import make_pose, rotation_of


class Scripted:
    """Wants what the skill of a task wants; it remembers nothing."""

    def __init__(self, task: str, phases: tuple[str, ...], impedance: Impedance, **traits: float) -> None:
        """Take the task's name and the names of its phases, how stiffly targets are followed, and what is done so.

        Args:
            task: Name of the task.
            phases: Names of its phases.
            impedance: How stiffly targets are followed.
            **traits: Fields of `skills.skill.SKILL` that are other than usual.

        Raises:
            ConfigError: If nobody knows how to do this task.
        """
        self._number, self._skill = skill_of(task, impedance)
        for name, value in traits.items():
            self._skill[name] = value
        self._phases = phases
        self._seen, self._wanted = np.zeros(1, PERCEIVED), np.zeros(1, WANTED)

    def want(self, perception: Perception) -> tuple[Float[np.ndarray, " 7"], str]:
        """The wanted target pose, and the name of the phase."""
        goal_m, R_goal = perception.goal_pose[:3], rotation_of(perception.goal_pose[3:])
        R, step, R_out, x_out = rotation_of(perception.tcp_pose[3:]), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
        seen, wanted = self._seen[0], self._wanted[0]
        perceive_into(perception.tcp_pose[:3], R, perception.wrench, perception.wrench_mean, goal_m, R_goal, seen)
        want(self._number, self._skill[0], seen, wanted)
        target_into(wanted, goal_m, R_goal, step, x_out, R_out)
        return make_pose(x_out, R_out), self._phases[int(wanted["phase"])]
