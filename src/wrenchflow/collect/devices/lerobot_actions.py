"""What actions of LeRobot's teleoperators mean: increments, the pose of something held, or a leader arm's joints."""

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.collect.devices.alignment import AlignmentGate, AlignmentLimits
from wrenchflow.collect.devices.device import GRIPPER_BUTTON, MARK_BUTTON
from wrenchflow.config import require_positive
from wrenchflow.errors import ConfigError, DeviceError
from wrenchflow.kinematics import Kinematics
from wrenchflow.spatial import make_pose, rotation_of

FULL_SCALE_COUNTS = 1000
_REST = np.zeros(6, np.int64)
_CLOSE, _STAY, _OPEN = 0, 1, 2  # LeRobot's words for a gripper.


class FollowerState(NamedTuple):
    """Where the arm that follows is.

    Attributes:
        q_rad: Its joint angles.
        pose: Of its target, T_base_tcp: what a device moves.
    """

    q_rad: Float[np.ndarray, " n"]
    pose: Float[np.ndarray, " 7"]


class Meant(NamedTuple):
    """What an action means for the arm, as in a `Reading`; `is_new` is False where a driver only repeats itself."""

    counts: Int64[np.ndarray, " 6"] = _REST
    buttons: int = 0
    pose: Float[np.ndarray, " 7"] | None = None
    problem: str = ""
    is_new: bool = True


@runtime_checkable
class Meaning(Protocol):
    """How one kind of action is understood."""

    def of(self, action: Mapping[str, Any], follower: FollowerState | None) -> Meant:
        """What an action means now; raises LookupError, TypeError or ValueError where it makes no sense."""
        ...

    def let_go(self) -> None:
        """Forget where the hand was: something failed, and nobody knows where it went meanwhile."""
        ...


class Increments:
    """`delta_x`, `delta_y`, `delta_z`: shares of full speed, x forward, y left, z up; and perhaps `gripper`."""

    def __init__(self, full_scale: float = 1.0) -> None:
        """Say how much full speed is; LeRobot's gamepad and keyboard give 1 there."""
        require_positive(full_scale=full_scale)
        self._full_scale, self._closed = full_scale, 0

    def of(self, action: Mapping[str, Any], follower: FollowerState | None) -> Meant:
        """Counts."""
        share = np.array([_number(action, f"delta_{axis}") for axis in "xyz"]) / self._full_scale
        if "gripper" in action:
            said = round(_number(action, "gripper"))
            if said not in (_CLOSE, _STAY, _OPEN):
                raise ValueError(f"gripper is {said}, expected 0, 1 or 2")
            self._closed = self._closed if said == _STAY else int(said == _CLOSE)
        counts = np.zeros(6, np.int64)
        counts[:3] = np.rint(np.clip(share, -1.0, 1.0) * FULL_SCALE_COUNTS)
        return Meant(counts=counts, buttons=self._closed << GRIPPER_BUTTON)

    def let_go(self) -> None:
        """Nothing: an increment has no past."""


@dataclass(frozen=True, kw_only=True)
class HeldConfig:
    """How the movement of something held moves the tool.

    Attributes:
        forward: The device's axis that is forward for the arm: a unit vector in what the device calls its frame. The
            default is LeRobot's own for a phone that was calibrated as its driver asks.
        up: Likewise the axis that is up.
        scale: Metres of the tool for a metre of the device; turns are never scaled.
    """

    forward: tuple[float, float, float] = (0.0, -1.0, 0.0)
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    scale: float = 1.0

    def __post_init__(self) -> None:
        require_positive(scale=self.scale)
        forward, up = np.array(self.forward), np.array(self.up)
        lengths = np.array([forward @ forward, up @ up])
        if not (np.abs(lengths - 1.0) < 1e-6).all() or abs(forward @ up) > 1e-6:
            raise ConfigError(f"forward and up are unit vectors at right angles, got {self.forward} and {self.up}.")

    @property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """From the device's axes to the arm's."""
        forward, up = np.array(self.forward), np.array(self.up)
        return np.stack([forward, np.cross(up, forward), up])


class HeldPose:
    """`<name>.pos`, `<name>.rot`, `<name>.enabled`, as of a phone: while enabled, the tool moves as the device does.

    Where the device was when it became enabled is where the target was then, so it can be let go of, moved back and
    taken up again like a mouse that is lifted.
    """

    def __init__(self, name: str, config: HeldConfig | None = None) -> None:
        self._name = name
        config = config or HeldConfig()
        self._R, self._scale = config.rotation, config.scale
        self._grasp: tuple[np.ndarray, np.ndarray, np.ndarray] | None = (
            None  # Of the device p and R, and of the target.
        )
        self._last: bytes = b""

    def of(self, action: Mapping[str, Any], follower: FollowerState | None) -> Meant:
        """A pose, while enabled."""
        enabled = bool(_value(action, f"{self._name}.enabled"))
        position_m = np.asarray(_value(action, f"{self._name}.pos"), np.float64)
        R = np.asarray(_value(action, f"{self._name}.rot").as_matrix(), np.float64)
        inputs = action.get(f"{self._name}.raw_inputs") or {}
        buttons = bool(inputs.get("reservedButtonA", inputs.get("b2"))) << GRIPPER_BUTTON
        buttons |= bool(inputs.get("reservedButtonB", inputs.get("b3"))) << MARK_BUTTON
        if position_m.shape != (3,) or not (np.isfinite(position_m).all() and np.isfinite(R).all()):
            raise ValueError("its pose is not three finite numbers and a rotation")
        if not enabled:
            self._grasp = None
            return Meant(buttons=buttons)
        if self._grasp is None:
            if follower is None:
                return Meant(problem="it is not known where the arm is")
            self._grasp = position_m, R, follower.pose.copy()
        # A tracker that has lost its picture goes on to say the last pose, to the bit; a hand never holds so still.
        said = position_m.tobytes() + R.tobytes()
        is_new, self._last = said != self._last, said
        start_m, R_start, target = self._grasp
        moved_m = self._R @ (position_m - start_m) * self._scale
        turned = self._R @ (R @ R_start.T) @ self._R.T
        pose = make_pose(target[:3] + moved_m, turned @ rotation_of(target[3:]))
        return Meant(buttons=buttons, pose=pose, is_new=is_new)

    def let_go(self) -> None:
        """Begin from where the target is, the next time."""
        self._grasp = None


@dataclass(frozen=True, kw_only=True)
class LeaderConfig:
    """What a leader arm is.

    Attributes:
        kinematics: From its joint angles [rad] to T_base_tcp of the arm that follows.
        units: Of what its driver says; needed where the driver does not tell itself.
        signs: Sense of each joint, 1 or -1; without it 1 for all.
        offsets_rad: What each joint of the follower is at where the leader says zero.
        limits: How alike leader and follower stand when the follower begins to follow.
    """

    kinematics: Kinematics
    units: Literal["", "degrees", "radians"] = ""
    signs: tuple[int, ...] = ()
    offsets_rad: tuple[float, ...] = ()
    limits: AlignmentLimits = field(default_factory=AlignmentLimits)


class LeaderJoints:
    """`<joint>.pos` of a leader arm, through forward kinematics, behind a gate."""

    def __init__(self, joints: tuple[str, ...], config: LeaderConfig) -> None:
        """Take the names of its joints, from the base on.

        Raises:
            DeviceError: If the configuration is one of an arm with another number of joints.
        """
        count = len(joints)
        signs, offsets = np.array(config.signs or (1,) * count), np.array(config.offsets_rad or (0.0,) * count)
        if len(signs) != count or len(offsets) != count or not np.isin(signs, (-1, 1)).all():
            raise DeviceError(
                f"a leader of the {count} joints {', '.join(joints)} takes as many signs of 1 or -1 and offsets, got "
                f"{list(config.signs)} and {list(config.offsets_rad)}."
            )
        self._joints, self._kinematics = joints, config.kinematics
        self._scale = signs * (math.pi / 180.0 if config.units == "degrees" else 1.0)
        self._offsets_rad, self._gate = offsets, AlignmentGate(config.limits)
        try:
            self._kinematics(offsets.astype(np.float64))
        except (ValueError, IndexError, TypeError) as error:
            raise DeviceError(
                f"the kinematics do not take the {count} joints {', '.join(joints)} of this leader: {error}"
            ) from error

    def of(self, action: Mapping[str, Any], follower: FollowerState | None) -> Meant:
        """A pose, once leader and follower have stood alike."""
        said = np.array([_number(action, f"{joint}.pos") for joint in self._joints])
        q_rad = said * self._scale + self._offsets_rad
        pose = self._kinematics(q_rad)
        if follower is None:
            return Meant(problem="it is not known where the arm is")
        problem = self._gate.look(q_rad, follower.q_rad, pose, follower.pose)
        return Meant(problem=problem) if problem else Meant(pose=pose)

    def let_go(self) -> None:
        """Ask for the arms to stand alike again."""
        self._gate.close()


def meaning_of(
    names: Collection[str],
    *,
    held: HeldConfig | None = None,
    leader: LeaderConfig | None = None,
    full_scale: float = 1.0,
) -> Meaning:
    """How actions of these names are understood.

    Raises:
        DeviceError: If they are none that can move an arm.
    """
    if {"delta_x", "delta_y", "delta_z"} <= set(names):
        return Increments(full_scale)
    for name in (name.removesuffix(".rot") for name in names if name.endswith(".rot")):
        if {f"{name}.pos", f"{name}.enabled"} <= set(names):
            return HeldPose(name, held)
    joints = tuple(name.removesuffix(".pos") for name in names if name.endswith(".pos") and name != "gripper.pos")
    if not joints:
        raise DeviceError(
            f"this teleoperator gives {', '.join(names) or 'nothing'}, expected delta_x, delta_y and delta_z, or pos, "
            "rot and enabled of something held, or <joint>.pos of a leader arm."
        )
    if leader is None:
        raise DeviceError(
            f"this teleoperator is a leader arm of the joints {', '.join(joints)}: say what its kinematics are, such "
            "as those of a Panda for a GELLO."
        )
    return LeaderJoints(joints, leader)


def _value(action: Mapping[str, Any], name: str) -> Any:
    if name not in action:
        raise LookupError(f"its action lacks {name}; it has {', '.join(action) or 'nothing'}")
    return action[name]


def _number(action: Mapping[str, Any], name: str) -> float:
    number = float(_value(action, name))
    if not math.isfinite(number):
        raise ValueError(f"{name} is {number}")
    return number
