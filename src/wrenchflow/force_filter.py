"""What a person may set about the filter of the force; loads nothing heavy, so that the command line can show it.

It is a base file because the very same filter runs in `process`, is written into data sets and policies, and runs again
where the policy does.
"""

from dataclasses import dataclass

from wrenchflow.config import require_between, require_positive
from wrenchflow.errors import ConfigError

LONGEST_MEDIAN = 101


@dataclass(frozen=True, kw_only=True)
class FilterConfig:
    """A median against spikes, if it is wanted, then a Butterworth low-pass.

    Attributes:
        cutoff_hz: The -3 dB point of the low-pass [Hz]; forward and backward it is the -6 dB point.
        order: Poles of the low-pass: each takes another 20 dB a decade, and lags.
        median_samples: Length of the running median before it, odd, or 0 for none. A spike of less than half of it is
            taken out whole; the causal median lags by half of it.
        resample_hz: Grid that unevenly sampled force is put on before it is filtered [Hz]; without it such force is
            refused.
    """

    cutoff_hz: float = 40.0
    order: int = 4
    median_samples: int = 0
    resample_hz: float | None = None

    def __post_init__(self) -> None:
        require_positive(**{"filter.cutoff_hz": self.cutoff_hz})
        require_between(1, 12, **{"filter.order": self.order})
        if self.median_samples and not (self.median_samples % 2 and 3 <= self.median_samples <= LONGEST_MEDIAN):
            raise ConfigError(
                f"filter.median_samples is {self.median_samples}, expected 0 or an odd number from 3 to "
                f"{LONGEST_MEDIAN}."
            )
        if self.resample_hz is not None:
            require_positive(**{"filter.resample_hz": self.resample_hz})
