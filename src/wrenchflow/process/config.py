"""What a person may set about `process`; loads nothing heavy, so that the command line can show it at once."""

from dataclasses import dataclass, field
from pathlib import Path

from wrenchflow.config import require_at_least, require_positive
from wrenchflow.errors import ConfigError
from wrenchflow.force_filter import FilterConfig


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
class InertiaConfig:
    """When the force that accelerates the payload is taken out of `wrench_zero_phase`.

    `wrench` keeps it: a running robot knows its acceleration too late.

    Attributes:
        compensate: Whether to do so.
        cutoff_hz: Of the low-pass, forward and backward, of the velocity that the acceleration is made of [Hz].
        least_m_s2: A recording whose payload never accelerates by more is left as it is [m/s^2].
    """

    compensate: bool = True
    cutoff_hz: float = 25.0
    least_m_s2: float = 0.5

    def __post_init__(self) -> None:
        require_positive(**{"inertia.cutoff_hz": self.cutoff_hz, "inertia.least_m_s2": self.least_m_s2})


@dataclass(frozen=True, kw_only=True)
class ContactConfig:
    """When a force or a moment counts as contact.

    A threshold that is not set follows from the noise that the bias window shows after the filter, and from the inertia
    of the payload: see `Thresholds`.

    Attributes:
        on_n: Contact begins where the norm of the force reaches this [N].
        off_n: It ends where the norm of the force falls below this, and that of the moment below its own [N].
        on_nm: Contact begins where the norm of the moment reaches this, too [N.m].
        off_nm: See `off_n` [N.m].
        min_dwell_s: A shorter contact does not count, and a shorter break does not end one [s].
    """

    on_n: float | None = None
    off_n: float | None = None
    on_nm: float | None = None
    off_nm: float | None = None
    min_dwell_s: float = 0.02

    def __post_init__(self) -> None:
        for unit in ("n", "nm"):
            on, off = getattr(self, f"on_{unit}"), getattr(self, f"off_{unit}")
            if (on is None) != (off is None):
                raise ConfigError(f"contact.on_{unit} and contact.off_{unit} are set together, or not at all.")
            if on is not None and not 0.0 < off < on:
                raise ConfigError(
                    f"contact takes 0 < off_{unit} < on_{unit}, got off_{unit} {off:g} and on_{unit} {on:g}."
                )
        require_at_least(0.0, **{"contact.min_dwell_s": self.min_dwell_s})


@dataclass(frozen=True, kw_only=True)
class ProcessConfig:
    """How raw force becomes force that can be believed.

    Attributes:
        filter: The grid, the median and the low-pass; deployment runs the same median and low-pass.
        inertia: When the force that accelerates the payload is taken out.
        calibration: A file that `calibrate` wrote, whose payload takes the place of that of a recording's rig.
        bias: The window that tells the sensor's bias.
        contact: When a force counts as contact.
        expects_contact: Whether a recording without any contact is a defect.
    """

    filter: FilterConfig = field(default_factory=FilterConfig)
    inertia: InertiaConfig = field(default_factory=InertiaConfig)
    calibration: Path | None = None
    bias: BiasConfig = field(default_factory=BiasConfig)
    contact: ContactConfig = field(default_factory=ContactConfig)
    expects_contact: bool = True
