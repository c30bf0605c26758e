"""From observations in the base frame to the numbers that a policy sees, in the frame of the goal, and back.

The same code runs on recorded steps in training and on live ones in deployment. Every value is computed row by row in
float64 and cast at the end, so one row at a time gives the same bits as all rows at once.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from jaxtyping import Float, Float32
from scipy.spatial.transform import Rotation

from wrenchflow.errors import ConfigError, DatasetError, unknown
from wrenchflow.observation import ACTION_WIDTH
from wrenchflow.spatial import make_pose, rotation_of, rotation_of_rot6d

_GOAL = "goal_pose"

type _Seen = Mapping[str, Float[np.ndarray, "T ..."]]


def _rotate(R_a_b: Float[np.ndarray, "*n 3 3"], vector: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Express vectors, given in the axes of b, in the axes of a.

    Written out as sums of products: a matrix product may add in another order for another number of rows.
    """
    return (
        R_a_b[..., :, 0] * vector[..., 0:1] + R_a_b[..., :, 1] * vector[..., 1:2] + R_a_b[..., :, 2] * vector[..., 2:3]
    )


def _rotate_pair(R_a_b: Float[np.ndarray, "*n 3 3"], pair: Float[np.ndarray, "*n 6"]) -> Float[np.ndarray, "*n 6"]:
    """Rotate a wrench, a twist or a rot6d: two vectors, one after the other."""
    return np.concatenate([_rotate(R_a_b, pair[..., :3]), _rotate(R_a_b, pair[..., 3:])], axis=-1)


def _position(seen: _Seen, R_goal_base: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 3"]:
    return _rotate(R_goal_base, seen["tcp_pose"][:, :3] - seen[_GOAL][:, :3])


def _rotation(seen: _Seen, R_goal_base: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 3"]:
    tcp = Rotation.from_quat(seen["tcp_pose"][:, 3:], scalar_first=True)
    goal = Rotation.from_quat(seen[_GOAL][:, 3:], scalar_first=True)
    return (goal.inv() * tcp).as_rotvec()


def _linear_velocity(seen: _Seen, R_goal_base: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 3"]:
    return _rotate(R_goal_base, seen["tcp_twist"][:, :3])


def _angular_velocity(seen: _Seen, R_goal_base: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 3"]:
    return _rotate(R_goal_base, seen["tcp_twist"][:, 3:])


def _wrench(seen: _Seen, R_goal_base: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 6"]:
    return _rotate_pair(R_goal_base, seen["wrench"])


def _wrench_mean(seen: _Seen, R_goal_base: Float[np.ndarray, "T 3 3"]) -> Float[np.ndarray, "T 6"]:
    return _rotate_pair(R_goal_base, seen["wrench_mean"])


@dataclass(frozen=True, kw_only=True)
class FeatureGroup:
    """Some columns of what a policy sees.

    Attributes:
        observation: The observation that they are made of, beside the goal.
        columns: Their names, with units.
        floors: The smallest change in each column that means anything, in its unit. Normalisation does not magnify
            anything smaller.
        compute: The columns, from observations in float64 and the rotation from base axes to the goal's.
    """

    observation: str
    columns: tuple[str, ...]
    floors: tuple[float, ...]
    compute: Callable[[_Seen, Float[np.ndarray, "T 3 3"]], Float[np.ndarray, "T d"]]


def _axes(name: str, unit: str) -> tuple[str, ...]:
    return tuple(f"{name}_{axis}_{unit}" for axis in "xyz")


_POSITION_FLOOR_M = 1e-3
_ROTATION_FLOOR_RAD = 0.0175  # One degree.
_WRENCH_FLOORS = (0.5,) * 3 + (0.02,) * 3  # [N], [N.m]

# All relative to the goal as perceived, in the goal's axes; the wrench is about the tool centre point.
FEATURE_GROUPS: Mapping[str, FeatureGroup] = MappingProxyType(
    {
        "position": FeatureGroup(
            observation="tcp_pose",
            columns=_axes("position", "m"),
            floors=(_POSITION_FLOOR_M,) * 3,
            compute=_position,
        ),
        "rotation": FeatureGroup(
            observation="tcp_pose",
            columns=_axes("rotation", "rad"),
            floors=(_ROTATION_FLOOR_RAD,) * 3,
            compute=_rotation,
        ),
        "linear_velocity": FeatureGroup(
            observation="tcp_twist",
            columns=_axes("linear_velocity", "m_s"),
            floors=(5e-3,) * 3,
            compute=_linear_velocity,
        ),
        "angular_velocity": FeatureGroup(
            observation="tcp_twist",
            columns=_axes("angular_velocity", "rad_s"),
            floors=(0.02,) * 3,
            compute=_angular_velocity,
        ),
        "wrench": FeatureGroup(
            observation="wrench",
            columns=_axes("force", "n") + _axes("torque", "nm"),
            floors=_WRENCH_FLOORS,
            compute=_wrench,
        ),
        "wrench_mean": FeatureGroup(
            observation="wrench_mean",
            columns=_axes("mean_force", "n") + _axes("mean_torque", "nm"),
            floors=_WRENCH_FLOORS,
            compute=_wrench_mean,
        ),
    }
)

FORCE_GROUPS = ("wrench", "wrench_mean")
WITH_FORCE = tuple(FEATURE_GROUPS)
# Under an impedance controller the rotation, its rate and the gap between reference and pose all follow from the
# contact wrench: a policy that sees them has a force sensor. A fair comparison without force leaves them out.
WITHOUT_FORCE = ("position", "linear_velocity")
PRESETS: Mapping[str, tuple[str, ...]] = MappingProxyType({"with_force": WITH_FORCE, "without_force": WITHOUT_FORCE})

ACTION_COLUMNS = _axes("target", "m") + _axes("target_x_axis", "1") + _axes("target_y_axis", "1")
ACTION_FLOORS = (_POSITION_FLOOR_M,) * 3 + (_ROTATION_FLOOR_RAD,) * 6


@dataclass(frozen=True)
class Features:
    """What a policy sees of the observations, and how it says where to go.

    Attributes:
        groups: Names in `FEATURE_GROUPS`, in the order of the columns.
    """

    groups: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in self.groups:
            if name not in FEATURE_GROUPS:
                raise ConfigError(unknown("feature group", name, FEATURE_GROUPS))
        if not self.groups or len(set(self.groups)) != len(self.groups):
            raise ConfigError(f"feature groups are {self.groups}, expected at least one, each once.")

    @property
    def observation_names(self) -> tuple[str, ...]:
        """Observations that are needed, in the order of `observation.OBSERVATIONS` first met."""
        return tuple(dict.fromkeys([FEATURE_GROUPS[name].observation for name in self.groups] + [_GOAL]))

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns, with units."""
        return tuple(column for name in self.groups for column in FEATURE_GROUPS[name].columns)

    @property
    def floors(self) -> tuple[float, ...]:
        """Smallest meaningful change in each column, in its unit."""
        return tuple(floor for name in self.groups for floor in FEATURE_GROUPS[name].floors)

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.columns)

    def columns_of(self, group: str) -> slice:
        """Where a group's columns are; an empty slice if the group is not among the features."""
        start = 0
        for name in self.groups:
            stop = start + len(FEATURE_GROUPS[name].columns)
            if name == group:
                return slice(start, stop)
            start = stop
        return slice(0, 0)

    def require(self, available: Iterable[str], where: str) -> None:
        """Refuse observations that do not hold all that the features are made of.

        Args:
            available: Names of the observations.
            where: Where they come from, for the message.

        Raises:
            DatasetError: If one is missing.
        """
        names = tuple(available)
        for name in self.observation_names:
            if name not in names:
                raise DatasetError(
                    f"{where} lacks observation '{name}', which the policy sees. It has: {', '.join(names) or 'none'}."
                )

    def encode(self, observations: Mapping[str, Float32[np.ndarray, "T ..."]]) -> Float32[np.ndarray, "T width"]:
        """Features of T steps.

        Args:
            observations: By name, in the base frame; `observation.OBSERVATIONS` gives shapes and units.

        Raises:
            DatasetError: If an observation is missing.
        """
        self.require(observations, "the step")
        seen = {name: observations[name].astype(np.float64) for name in self.observation_names}
        R_goal_base = np.swapaxes(rotation_of(seen[_GOAL][:, 3:]), -1, -2)
        made = [FEATURE_GROUPS[name].compute(seen, R_goal_base) for name in self.groups]
        return np.concatenate(made, axis=-1).astype(np.float32)


def encode_actions(
    actions: Float32[np.ndarray, "T 9"], goal_pose: Float32[np.ndarray, "T 7"]
) -> Float32[np.ndarray, "T 9"]:
    """Targets in the base frame (position [m], rot6d) as targets in the goal's frame.

    Args:
        actions: One a step, in the base frame. Shape (T, 9).
        goal_pose: The goal as perceived at each step. Shape (T, 7).
    """
    goal = goal_pose.astype(np.float64)
    target = actions.astype(np.float64)
    R_goal_base = np.swapaxes(rotation_of(goal[:, 3:]), -1, -2)
    position_m = _rotate(R_goal_base, target[:, :3] - goal[:, :3])
    return np.concatenate([position_m, _rotate_pair(R_goal_base, target[:, 3:])], axis=-1).astype(np.float32)


def decode_actions(
    encoded: Float[np.ndarray, "*n 9"], goal_pose: Float[np.ndarray, "*m 7"]
) -> Float[np.ndarray, "*n 7"]:
    """Targets in the goal's frame, as a network puts them out, as poses in the base frame.

    Args:
        encoded: Position [m] and rot6d, not necessarily orthonormal. Shape (..., 9).
        goal_pose: The goal as perceived. Shape (..., 7), its leading axes broadcast.
    """
    assert encoded.shape[-1] == ACTION_WIDTH
    target = encoded.astype(np.float64)
    goal = np.broadcast_to(goal_pose.astype(np.float64), (*target.shape[:-1], 7))
    R_base_goal = rotation_of(goal[..., 3:])
    position_m = goal[..., :3] + _rotate(R_base_goal, target[..., :3])
    return make_pose(position_m, rotation_of_rot6d(_rotate_pair(R_base_goal, target[..., 3:])))
