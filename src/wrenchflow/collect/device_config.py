"""What a person may set about the device that they hold; loads nothing heavy."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from wrenchflow.config import require_between
from wrenchflow.errors import ConfigError

MOST_RAD = 4.0 * math.pi  # Two turns: a leader's joint that stands further off was given in degrees.


@dataclass(frozen=True, kw_only=True)
class DeviceConfig:
    """The device of an operator that is one.

    Attributes:
        patience_s: A device that cannot be followed for so long ends the attempt [s].
        gripper_button: Of a SpaceMouse, counted from 0: what opens and closes the gripper.
        mark_button: Likewise: what marks a moment.
        tap_s: How long a first press of a key counts as held, where the terminal tells of no releases [s].
        recording: What `replay` plays: a recording of a demonstration.
        full_scale_counts: What an axis of its device reports at full deflection, where it does not say so itself.
        kind: What `lerobot` connects, such as `so101_leader` or `phone`.
        settings: What it wants to know, such as `port=/dev/ttyACM0 id=mine`.
        full_scale: What its increments are at full deflection.
        scale: Metres of the tool for a metre of what is held.
        is_leader: Whether it is a leader arm, whose joints stand for those of the arm that follows.
        units: Of a leader's joints, where its driver does not say.
        signs: Sense of each of them, 1 or -1; without it 1 for all.
        offsets_rad: What each joint of the arm is at where the leader's says zero [rad].
    """

    patience_s: float = 2.0
    gripper_button: int = 0
    mark_button: int = 1
    tap_s: float = 0.15
    recording: Path | None = None
    full_scale_counts: int | None = None
    kind: str = ""
    settings: tuple[str, ...] = ()
    full_scale: float = 1.0
    scale: float = 1.0
    is_leader: bool = False
    units: Literal["", "degrees", "radians"] = ""
    signs: tuple[int, ...] = ()
    offsets_rad: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        require_between(0.01, 60, **{"device.patience_s": self.patience_s})
        require_between(0.005, 2, **{"device.tap_s": self.tap_s})
        require_between(1e-6, 1e6, **{"device.full_scale": self.full_scale})
        require_between(0.01, 10, **{"device.scale": self.scale})
        buttons = {"device.gripper_button": self.gripper_button, "device.mark_button": self.mark_button}
        require_between(0, 47, **buttons)
        if self.full_scale_counts is not None:
            require_between(1, 1e6, **{"device.full_scale_counts": self.full_scale_counts})
        require_between(-MOST_RAD, MOST_RAD, **{"device.offsets_rad": max(self.offsets_rad, key=abs, default=0.0)})
        for setting in self.settings:
            if not setting.partition("=")[1]:
                raise ConfigError(f"a setting of a device is NAME=VALUE, got '{setting}'.")
