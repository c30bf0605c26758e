"""What the columns of foreign data sets are called: the names that others use for a pose, a joint, a force."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

# Of robomimic files and of LeRobot's features, the first that is there: ours, robosuite's, and what labs wrote.
POSITIONS = ("ee_pos", "robot0_eef_pos", "eef_pos", "tcp_pos", "ee_position")
JOINTS = ("joint_pos", "robot0_joint_pos", "joint_positions", "joint_position", "qpos")
WRENCHES = ("force_torque", "robot0_ee_wrench", "ee_wrench", "wrench", "ft", "robot0_ee_ft")
FORCES = ("robot0_ee_force", "ee_force", "force")
MOMENTS = ("robot0_ee_torque", "ee_torque")
TORQUES = ("joint_torques", "joint_torque", "robot0_joint_torque", "motor_torques_measured", "effort")
TASKS, LABS = ("task", "language_instruction", "current_task"), ("lab", "institution")
COLLECTORS, SCENES = ("operator", "collector_id", "collector", "user", "user_id"), ("scene_id", "scene", "building")
OUTCOMES = ("success", "is_episode_successful", "is_success", "next.success")


def first[T](there: Mapping[str, T], names: Iterable[str]) -> T | None:
    """What has the first of some names that is there."""
    return next((there[name] for name in names if name in there), None)


def by_prefix(columns: Sequence[str], data: Float[np.ndarray, "n d"]) -> dict[str, Float[np.ndarray, "n k"]]:
    """Parts of a table whose columns are called `part.column`, by part."""
    places: dict[str, list[int]] = {}
    for i, column in enumerate(columns):
        places.setdefault(column.rpartition(".")[0], []).append(i)
    return {name: data[:, at] for name, at in places.items() if name}
