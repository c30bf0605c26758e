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


def plain(columns: tuple[str, ...], units: tuple[str, ...]) -> Signal:
    """Columns that nothing here knows more of than a name and a unit each: what else a foreign file holds."""
    return Signal("plain", columns, units)


WRENCH = Signal("wrench", ("fx", "fy", "fz", "tx", "ty", "tz"), ("N",) * 3 + ("N.m",) * 3)
FORCE = Signal("force", ("fx", "fy", "fz"), ("N",) * 3)
POSE = Signal("pose", ("x", "y", "z", "qw", "qx", "qy", "qz"), ("m",) * 3 + ("1",) * 4)
POSITION = Signal("position", POSE.columns[:3], POSE.units[:3])
TWIST = Signal("twist", ("vx", "vy", "vz", "wx", "wy", "wz"), ("m/s",) * 3 + ("rad/s",) * 3)
VELOCITY = Signal("velocity", TWIST.columns[:3], TWIST.units[:3])
JOINTS = joints(ARM_JOINTS)
JOINT_TORQUE = joint_torque(ARM_JOINTS)
_STIFFNESS = tuple(f"k_{part}_{row}{col}" for part in ("lin", "rot") for row in "xyz" for col in "xyz")
_STIFFNESS_UNITS = ("N/m",) * 9 + ("N.m/rad",) * 9
IMPEDANCE = Signal("impedance", (*_STIFFNESS, "damping_ratio"), (*_STIFFNESS_UNITS, "1"))
# What was asked besides a pose: impedance, feed-forward, and the width of the gripper, NaN where none was asked.
REQUEST = Signal(
    "request",
    (*IMPEDANCE.columns, *WRENCH.columns, "gripper"),
    (*IMPEDANCE.units, *WRENCH.units, "m"),
)
# What the safety layer did, and why: its mode, the safeguard that changed it (-1 for none), those that intervened at
# this tick as a number with a bit for each, energies and sums of work, the feed-forward that was given, and the norms
# of the force and the moment that it felt and of the force that it looked for impacts in.
GOVERNOR = Signal(
    "governor",
    (
        *("mode", "cause", "acting"),
        *("tank", "spring", "budget", "kinetic"),
        *("damped", "fed", "posed", "saturated", "exerted", "filled"),
        *WRENCH.columns,
        *("force", "moment", "impact"),
    ),
    ("1",) * 3 + ("J",) * 10 + WRENCH.units + ("N", "N.m", "N"),
)
JOY = Signal("joy", ("x", "y", "z", "rx", "ry", "rz", "button_left", "button_right"), ("1",) * 8)
