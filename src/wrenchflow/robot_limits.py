"""What an arm can bear: the limits of its joints and of its tool centre point, as a table of TOML states them.

Limits belong to a description, not to code. The robots that come with wrenchflow are in `robots/`.
"""

from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Float

from wrenchflow.config import require_finite, require_order
from wrenchflow.errors import ConfigError
from wrenchflow.signals import ARM_JOINTS

Vector3 = tuple[float, float, float]
JointValues = tuple[float, ...]


@dataclass(frozen=True, kw_only=True)
class Slowing:
    """How the speed limit of a joint falls towards its ends: dq <= -offset + sqrt(slope (max - q)), mirrored for min.

    The ends here are where the curve is anchored, a little beyond the joint's own limits of position.
    """

    slope_rad_s2: JointValues
    offset_rad_s: JointValues
    min_rad: JointValues
    max_rad: JointValues

    def __post_init__(self) -> None:
        _require_joints(self, "robot.slowing")
        require_order("robot.slowing", self.min_rad, self.max_rad)


@dataclass(frozen=True, kw_only=True)
class RobotLimits:
    """Limits of an arm, one value a joint; what is None is not stated.

    Recordings of before the safety layer state less, and nothing that reads a recording needs more. Control does: it
    refuses an arm that leaves any of `STATED_FOR_CONTROL` open.

    Attributes:
        name: Of the robot.
        position_min_rad: Lower ends of the joints.
        position_max_rad: Upper ends.
        velocity_rad_s: Largest speed anywhere between them.
        torque_nm: Largest torque, without gravity.
        torque_rate_nm_s: Its largest change.
        acceleration_rad_s2: Largest acceleration.
        jerk_rad_s3: Largest jerk.
        tcp_speed_m_s: Largest speed of the tool centre point.
        tcp_turn_rad_s: Largest rate of turn of the tool.
        shoulder_m: The point, in the base frame, that `reach_m` counts from.
        reach_m: How far away from there the flange can be.
        joint_inertia_kg_m2: Smallest eigenvalue of the joint inertia, rotors included, in any posture.
        flange_inertia_kg: Least that a push at the bare flange has to move, in any posture and direction.
        flange_inertia_kg_m2: Least that a turn of the bare flange has to move.
        slowing: Of robots whose speed limit depends on the posture.
    """

    name: str
    position_min_rad: JointValues
    position_max_rad: JointValues
    velocity_rad_s: JointValues
    torque_nm: JointValues
    torque_rate_nm_s: JointValues
    acceleration_rad_s2: JointValues | None = None
    jerk_rad_s3: JointValues | None = None
    tcp_speed_m_s: float | None = None
    tcp_turn_rad_s: float | None = None
    shoulder_m: Vector3 | None = None
    reach_m: float | None = None
    joint_inertia_kg_m2: float | None = None
    flange_inertia_kg: float | None = None
    flange_inertia_kg_m2: float | None = None
    slowing: Slowing | None = None

    def __post_init__(self) -> None:
        _require_joints(self, "robot")
        require_order("robot.position", self.position_min_rad, self.position_max_rad)
        for name in STATED_FOR_CONTROL:
            if isinstance(value := getattr(self, name), float):
                require_finite(f"robot.{name}", (value,), positive=True)
        if self.shoulder_m is not None:
            require_finite("robot.shoulder_m", self.shoulder_m)

    def speed_limits(
        self, q_rad: Float[np.ndarray, "*n 7"]
    ) -> tuple[Float[np.ndarray, "*n 7"], Float[np.ndarray, "*n 7"]]:
        """The lowest (0 at most) and the highest (0 at least) joint speed [rad/s] that postures allow.

        Args:
            q_rad: Joint angles. Shape (..., 7).

        Source: libfranka, `rate_limiting.h` for the FR3. A robot without `slowing` has the same limits everywhere.
        """
        most = np.broadcast_to(np.array(self.velocity_rad_s), q_rad.shape)
        if self.slowing is None:
            return -most, most.copy()
        slope, offset = np.array(self.slowing.slope_rad_s2), np.array(self.slowing.offset_rad_s)
        below = np.sqrt(np.maximum(0.0, slope * (q_rad - np.array(self.slowing.min_rad)))) - offset
        above = np.sqrt(np.maximum(0.0, slope * (np.array(self.slowing.max_rad) - q_rad))) - offset
        return -np.clip(below, 0.0, most), np.clip(above, 0.0, most)


# What reading a recording can do without, and control cannot.
STATED_FOR_CONTROL = (
    "acceleration_rad_s2",
    "jerk_rad_s3",
    "tcp_speed_m_s",
    "tcp_turn_rad_s",
    "shoulder_m",
    "reach_m",
    "joint_inertia_kg_m2",
    "flange_inertia_kg",
    "flange_inertia_kg_m2",
)
_MAY_BE_NEGATIVE = ("position_min_rad", "position_max_rad", "min_rad", "max_rad")


def _require_joints(limits: RobotLimits | Slowing, where: str) -> None:
    """Refuse what is stated by joint and has another number of values, or values that limit nothing."""
    for field in fields(limits):
        values = getattr(limits, field.name)
        if field.type not in (JointValues, JointValues | None) or values is None:
            continue
        if len(values) != ARM_JOINTS:
            raise ConfigError(
                f"{where}.{field.name} has {len(values)} values, expected one for each of {ARM_JOINTS} joints."
            )
        require_finite(f"{where}.{field.name}", values, positive=field.name not in _MAY_BE_NEGATIVE)
