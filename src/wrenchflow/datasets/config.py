"""What a person may set about `export`; loads nothing heavy, so that the command line can show it at once."""

from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

from wrenchflow.config import require_between
from wrenchflow.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class ExportConfig:
    """How episodes become a data set.

    Attributes:
        rate_hz: Steps a second; the policy will run at this rate [Hz].
        grid: `rate` for steps at that rate, or the name of a camera whose pictures are the steps; `rate_hz` then says
            what they are nominally taken at.
        gaps: What becomes of steps without the samples that they need: they divide the episode (`split`), they are kept
            with the values before and marked as not valid (`mark`), or the episode is left out (`refuse`).
        cameras: Cameras whose pictures go along; all that the first episode has where it is not said.
        force_window: Write the last 50 samples of the wrench of each step, which are most of a data set's bytes.
        image_px: Width and height of pictures in files of arrays; videos keep the camera's own.
        valid_fraction: Share of the recordings that is named for validation.
        only_success: Leave out attempts that do not say that they succeeded.
        masks: Masks by quality, each as NAME=CONDITION on the quality table, such as gentle=max_force<10.
        next_obs: Write what follows each step beside it, which robomimic's algorithms for reinforcement learning want;
            it doubles the file.
    """

    rate_hz: float = 20.0
    grid: str = "rate"
    gaps: Literal["split", "mark", "refuse"] = "split"
    cameras: tuple[str, ...] | None = None
    force_window: bool = True
    image_px: int = 84
    valid_fraction: float = 0.1
    only_success: bool = True
    next_obs: bool = False
    masks: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 < self.rate_hz <= 1000.0:
            raise ConfigError(f"rate_hz must be above 0 and 1000 at most, got {self.rate_hz:g}.")
        if not 0.0 <= self.valid_fraction < 1.0:
            raise ConfigError(f"valid_fraction must be 0 or more and below 1, got {self.valid_fraction:g}.")
        require_between(8, 4096, image_px=self.image_px)

    @property
    def rate(self) -> Fraction:
        """The rate [Hz] as the fraction that was meant: 29.97 is 2997/100."""
        return Fraction(self.rate_hz).limit_denominator(1001)
