"""What a person may set about `process`; loads nothing heavy, so that the command line can show it at once."""

from dataclasses import dataclass, field

from wrenchflow.config import require_positive
from wrenchflow.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class BiasConfig:
    """Which window tells the sensor's bias, and what makes that window unfit.

    Attributes:
        window_s: Length of the window at the start of a recording that marks none as `tare` [s].
        min_window_s: A shorter window is refused [s].
        max_joint_velocity_rad_s: Any joint that is faster is moving [rad/s].
        max_spread: Most standard deviation, in multiples of the sensor's own noise.
        max_drift: Most change from the window's start to its end, in multiples of the sensor's own noise.
        max_force_n: Most force that is left on any axis once the payload's weight is taken out [N]: as much as the bias
            of a sensor at power-up. More than that is a payload that is set wrong, or a contact.
    """

    window_s: float = 0.5
    min_window_s: float = 0.2
    max_joint_velocity_rad_s: float = 0.01
    max_spread: float = 2.0
    max_drift: float = 2.0
    max_force_n: float = 2.0

    def __post_init__(self) -> None:
        require_positive(
            **{
                f"bias.{name}": getattr(self, name)
                for name in ("max_joint_velocity_rad_s", "max_spread", "max_drift", "max_force_n")
            }
        )
        if not 0.0 < self.min_window_s <= self.window_s:
            raise ConfigError(
                f"bias.window_s must be at least bias.min_window_s and that above 0, "
                f"got {self.window_s:g} s and {self.min_window_s:g} s."
            )


@dataclass(frozen=True, kw_only=True)
class ContactConfig:
    """When a force counts as contact.

    Attributes:
        on_n: Contact begins where the force norm reaches this [N].
        off_n: It ends where the norm falls below this [N]. Both stand above what noise and the inertia of the tool
            leave in free motion.
        min_dwell_s: A shorter contact does not count, and a shorter break does not end one [s].
    """

    on_n: float = 2.0
    off_n: float = 1.0
    min_dwell_s: float = 0.02

    def __post_init__(self) -> None:
        if not 0.0 < self.off_n < self.on_n or self.min_dwell_s < 0.0:
            raise ConfigError(
                f"contact takes 0 < off_n < on_n and a min_dwell_s of 0 or more, "
                f"got off_n {self.off_n:g}, on_n {self.on_n:g} and min_dwell_s {self.min_dwell_s:g}."
            )


@dataclass(frozen=True, kw_only=True)
class ProcessConfig:
    """How raw force becomes force that can be believed.

    Attributes:
        cutoff_hz: The -3 dB point of the causal 4th-order Butterworth low-pass [Hz].
        bias: The window that tells the sensor's bias.
        contact: When a force counts as contact.
    """

    cutoff_hz: float = 40.0
    bias: BiasConfig = field(default_factory=BiasConfig)
    contact: ContactConfig = field(default_factory=ContactConfig)

    def __post_init__(self) -> None:
        require_positive(cutoff_hz=self.cutoff_hz)
