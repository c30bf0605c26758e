"""The names that peers know observations by, and how our columns map onto them and back, bit for bit."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float32

from wrenchflow.observation import MEAN_NS, OBSERVATIONS, RULES
from wrenchflow.signals import ARM_JOINTS, TWIST, WRENCH


@dataclass(frozen=True, kw_only=True)
class Key:
    """An exported observation.

    Attributes:
        name: Its name in the export.
        observation: The observation in `OBSERVATIONS` that it is cut from.
        take: The columns that it takes, in its own order.
        columns: Their names.
        units: Their units.
        frame: What the values are expressed in.
        rule: How a value comes from the recorded samples, in one sentence.
    """

    name: str
    observation: str
    take: tuple[int, ...]
    columns: tuple[str, ...]
    units: tuple[str, ...]
    frame: str
    rule: str

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of one step's value."""
        return (*OBSERVATIONS[self.observation][:-1], len(self.take))

    def described(self, wrench_group_delay_s: float | None) -> dict[str, Any]:
        """What a data set says of it, as plain values.

        Args:
            wrench_group_delay_s: How far the causal filter makes the wrench lag behind slow changes [s].
        """
        rule = RULES[self.observation]
        group_delay_s = 0.0 if rule.stream != "wrench" else wrench_group_delay_s
        if rule.method == "mean" and group_delay_s is not None:
            group_delay_s += 0.5e-9 * MEAN_NS
        return {
            "columns": self.columns,
            "units": self.units,
            "frame": self.frame,
            "stream": rule.stream,
            "method": rule.method,
            "rule": self.rule,
            "causal": rule.is_causal,
            "group_delay_s": group_delay_s,
        }


def _position(name: str, observation: str, rule: str) -> Key:
    return Key(
        name=name,
        observation=observation,
        take=(0, 1, 2),
        columns=("x", "y", "z"),
        units=("m",) * 3,
        frame="base",
        rule=rule,
    )


def _quaternion(name: str, observation: str, rule: str) -> Key:
    return Key(
        name=name,
        observation=observation,
        take=(4, 5, 6, 3),
        columns=("qx", "qy", "qz", "qw"),
        units=("1",) * 4,
        frame="base",
        rule=f"{rule}; order xyzw, and of the two signs the one with qx >= 0",
    )


def _joints(name: str, observation: str, symbol: str, unit: str) -> Key:
    return Key(
        name=name,
        observation=observation,
        take=tuple(range(ARM_JOINTS)),
        columns=tuple(f"{symbol}{i + 1}" for i in range(ARM_JOINTS)),
        units=(unit,) * ARM_JOINTS,
        frame="joints",
        rule=_LINEAR,
    )


def _wrench(name: str, observation: str, rule: str) -> Key:
    return Key(
        name=name,
        observation=observation,
        take=tuple(range(WRENCH.width)),
        columns=WRENCH.columns,
        units=WRENCH.units,
        frame="base axes, about the tool centre point; what the robot exerts on its environment",
        rule=rule,
    )


_LINEAR = "on the line between the two nearest samples"
_SLERP = "by slerp between the two nearest samples"
_HELD = "the last value that was said"

KEYS = (
    _position("ee_pos", "tcp_pose", _LINEAR),
    _quaternion("ee_quat", "tcp_pose", _SLERP),
    Key(
        name="tcp_twist",
        observation="tcp_twist",
        take=tuple(range(TWIST.width)),
        columns=TWIST.columns,
        units=TWIST.units,
        frame="base",
        rule=_LINEAR,
    ),
    _joints("joint_pos", "joint_position", "q", "rad"),
    _joints("joint_vel", "joint_velocity", "dq", "rad/s"),
    _wrench("force_torque", "wrench", "the last causally filtered sample at or before the step"),
    _wrench("force_torque_mean", "wrench_mean", "mean of the causally filtered samples of the last 100 ms"),
    _wrench("force_window", "wrench_window", "the last 50 causally filtered samples, oldest first"),
    _position("goal_pos", "goal_pose", _HELD),
    _quaternion("goal_quat", "goal_pose", _HELD),
)
ACTION_COLUMNS = ("x", "y", "z", "r11", "r21", "r31", "r12", "r22", "r32")
ACTION_UNITS = ("m",) * 3 + ("1",) * 6
ACTION_RULE = (
    "target of the tool centre point at the next step, in the base frame: position, then rot6d (the first two columns "
    "of the rotation matrix); a command, held and never interpolated"
)
SKEW_RULE = "how old the newest sample of the stream was at the step [ns]"
VALID_RULE = (
    "1 where the stream had the samples that the step needs; where it is 0, values are those of the step before"
)


def keys_of(observations: Iterable[str]) -> tuple[Key, ...]:
    """Those of `KEYS` that some observations make."""
    there = set(observations)
    return tuple(key for key in KEYS if key.observation in there)


def to_keys(observations: Mapping[str, Float32[np.ndarray, "T ..."]]) -> dict[str, Float32[np.ndarray, "T ..."]]:
    """Observations under the names, and in the column order, of `KEYS`."""
    return {
        key.name: np.ascontiguousarray(observations[key.observation][..., key.take]) for key in keys_of(observations)
    }


def from_keys(values: Mapping[str, Float32[np.ndarray, "T ..."]]) -> dict[str, Float32[np.ndarray, "T ..."]]:
    """The observations that `to_keys` made the values from."""
    length = len(values[KEYS[0].name])
    there = {key.observation for key in KEYS if key.name in values}
    made = {name: np.empty((length, *shape), np.float32) for name, shape in OBSERVATIONS.items() if name in there}
    for key in keys_of(there):
        made[key.observation][..., key.take] = values[key.name]
    return made
