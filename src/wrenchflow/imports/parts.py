"""What a stream is put together of: which parts make which signal, and their columns and units."""

from dataclasses import dataclass

from wrenchflow import signals
from wrenchflow.signals import Signal


@dataclass(frozen=True)
class PartKind:
    """A part of a signal: its unit, and its width where that does not depend on the arm."""

    unit: str
    width: int | None


PARTS = {
    "force": PartKind("N", 3),
    "moment": PartKind("N.m", 3),
    "position": PartKind("m", 3),
    "orientation": PartKind("rad", None),
    "linear": PartKind("m/s", 3),
    "angular": PartKind("rad/s", 3),
    "joint_position": PartKind("rad", None),
    "joint_velocity": PartKind("rad/s", None),
    "joint_torque": PartKind("N.m", None),
    "values": PartKind("", None),
}
_JOINTS = ("joint_position", "joint_velocity", "joint_torque")
# The parts of each kind of signal, in the order of its columns.
PARTS_OF_KIND: dict[str, tuple[str, ...]] = {
    "force": ("force",),
    "wrench": ("force", "moment"),
    "position": ("position",),
    "pose": ("position", "orientation"),
    "velocity": ("linear",),
    "twist": ("linear", "angular"),
    "joints": _JOINTS,
    "joint_torque": ("joint_torque",),
    "plain": ("values",),
}
KIND_OF_PARTS = {frozenset(parts): kind for kind, parts in PARTS_OF_KIND.items()}
# What is exerted, whose sign depends on who exerts it.
SIGNED = ("wrench", "force")
# Whose values do not depend on a frame, so that nobody needs to state one.
FRAMELESS = ("joints", "joint_torque", "plain")
_SIGNALS = {
    "force": signals.FORCE,
    "wrench": signals.WRENCH,
    "position": signals.POSITION,
    "pose": signals.POSE,
    "velocity": signals.VELOCITY,
    "twist": signals.TWIST,
}


def signal_of(kind: str, width: int) -> Signal:
    """The signal of a kind that is not `plain`; `width` is its number of columns."""
    if kind == "joints":
        return signals.joints(width // len(_JOINTS))
    return signals.joint_torque(width) if kind == "joint_torque" else _SIGNALS[kind]


def part_columns(kind: str, part: str, width: int) -> slice:
    """Which of a signal's `width` columns a part of it takes."""
    if kind == "pose":
        return slice(0, 3) if part == "position" else slice(3, 7)
    parts = PARTS_OF_KIND[kind]
    size = width // len(parts)
    first = size * parts.index(part)
    return slice(first, first + size)
