"""What a person may set about control; loads nothing heavy, so that the command line can show it at once."""

import math
from dataclasses import dataclass, fields

from wrenchflow.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class Impedance:
    """How stiffly a target is followed, in the base frame."""

    translation_n_m: float = 600.0
    rotation_nm_rad: float = 25.0
    damping_ratio: float = 0.9

    def __post_init__(self) -> None:
        # There is no upper end here: the core limits what is asked, whoever asks.
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < math.inf:
                raise ConfigError(f"impedance.{field.name} is {value:g}, expected a number above 0.")


@dataclass(frozen=True, kw_only=True)
class ControlConfig:
    """Limits and gains of the control core that no request can change."""

    nullspace_nm_rad: float = 2.0
    ramp_s: float = 1.0
    damping_design_hz: float = 100.0
    force_max_n: float = 25.0
    moment_max_nm: float = 3.0
    speed_max_m_s: float = 0.25
    turn_max_rad_s: float = 1.0
    stiffness_max_n_m: float = 1500.0
    stiffness_max_nm_rad: float = 60.0
    # More damping than this is mostly the noise of the measured velocity: from three on it fills the torque's rate.
    damping_ratio_max: float = 2.0
    # Shares of the robot's own limits that a command may use: a margin for what happens between two ticks.
    torque_share: float = 0.96
    torque_rate_share: float = 0.5

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name.endswith("_share") and not 0.0 < value <= 1.0:
                raise ConfigError(f"control.{field.name} is {value:g}, expected above 0 and 1 at most.")
            may_be_zero = field.name in ("nullspace_nm_rad", "ramp_s")
            if not (math.isfinite(value) and (value > 0.0 or (may_be_zero and value == 0.0))):
                raise ConfigError(f"control.{field.name} is {value:g}, expected a number above 0.")
