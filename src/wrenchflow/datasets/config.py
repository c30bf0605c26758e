"""What a person may set about `export`; loads nothing heavy, so that the command line can show it at once."""

from dataclasses import dataclass
from fractions import Fraction

from wrenchflow.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class ExportConfig:
    """How episodes become a data set.

    Attributes:
        rate_hz: Steps a second; the policy will run at this rate [Hz].
        valid_fraction: Share of the episodes that is named for validation.
        only_success: Leave out attempts that do not say that they succeeded.
    """

    rate_hz: float = 20.0
    valid_fraction: float = 0.1
    only_success: bool = True

    def __post_init__(self) -> None:
        if not 0.0 < self.rate_hz <= 1000.0:
            raise ConfigError(f"rate_hz must be above 0 and 1000 at most, got {self.rate_hz:g}.")
        if not 0.0 <= self.valid_fraction < 1.0:
            raise ConfigError(f"valid_fraction must be 0 or more and below 1, got {self.valid_fraction:g}.")

    @property
    def rate(self) -> Fraction:
        """The rate [Hz] as the fraction that was meant: 29.97 is 2997/100."""
        return Fraction(self.rate_hz).limit_denominator(1001)
