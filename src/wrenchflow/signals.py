"""What a stream measures: column names and units. This is the one place that states the wrench's sign.

Sign of every wrench in wrenchflow: what the robot exerts on its environment (libfranka's sign). Pressing down on a
table gives a negative fz in a base frame whose z points up.
"""

from dataclasses import dataclass

from wrenchflow.errors import StreamError

ARM_JOINTS = 7


@dataclass(frozen=True)
class Signal:
    """A kind of measurement: its name, and one name and one unit a column."""

    kind: str
    columns: tuple[str, ...]
    units: tuple[str, ...]

    def __post_init__(self) -> None:
        if len(self.columns) != len(self.units):
            raise StreamError(
                f"signal '{self.kind}' has {len(self.columns)} columns but {len(self.units)} units; one unit a column."
            )

    @property
    def width(self) -> int:
        """Number of columns."""
        return len(self.columns)


def _numbered(name: str, count: int) -> tuple[str, ...]:
    return tuple(f"{name}{i + 1}" for i in range(count))


def joints(count: int) -> Signal:
    """Position [rad], velocity [rad/s] and torque [N.m] of `count` joints, in this order, without gravity."""
    columns = _numbered("q", count) + _numbered("dq", count) + _numbered("tau", count)
    return Signal("joints", columns, ("rad",) * count + ("rad/s",) * count + ("N.m",) * count)


def joint_torque(count: int) -> Signal:
    """Torque of `count` joints [N.m], without gravity."""
    return Signal("joint_torque", _numbered("tau", count), ("N.m",) * count)


def mask(columns: tuple[str, ...]) -> Signal:
    """One flag (0 to 255) a column, such as which anomaly a sample shows."""
    return Signal("mask", columns, ("1",) * len(columns))


WRENCH = Signal("wrench", ("fx", "fy", "fz", "tx", "ty", "tz"), ("N",) * 3 + ("N.m",) * 3)
FORCE = Signal("force", ("fx", "fy", "fz"), ("N",) * 3)
POSE = Signal("pose", ("x", "y", "z", "qw", "qx", "qy", "qz"), ("m",) * 3 + ("1",) * 4)
TWIST = Signal("twist", ("vx", "vy", "vz", "wx", "wy", "wz"), ("m/s",) * 3 + ("rad/s",) * 3)
JOINTS = joints(ARM_JOINTS)
JOINT_TORQUE = joint_torque(ARM_JOINTS)
IMPEDANCE = Signal(
    "impedance",
    tuple(f"k_{part}_{row}{col}" for part in ("lin", "rot") for row in "xyz" for col in "xyz") + ("damping_ratio",),
    ("N/m",) * 9 + ("N.m/rad",) * 9 + ("1",),
)
JOY = Signal("joy", ("x", "y", "z", "rx", "ry", "rz", "button_left", "button_right"), ("1",) * 8)
