"""How a device's axes become a twist of the target. Real and emulated devices share it."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class TwistMap:
    """From axis counts to a twist of the target in the base frame, and back.

    A deadzone keeps a resting hand still; past it the twist grows in proportion from zero, so the map can be inverted.
    """

    full_scale_counts: int = 350
    deadzone: float = 0.05  # share of the full scale
    linear_max_m_s: float = 0.20
    angular_max_rad_s: float = 0.8

    def __post_init__(self) -> None:
        if self.full_scale_counts < 1 or not 0.0 <= self.deadzone < 1.0:
            raise ConfigError(
                f"a twist map takes full_scale_counts of 1 or more and a deadzone from 0 to below 1, got "
                f"{self.full_scale_counts} and {self.deadzone:g}."
            )
        if not (0.0 < self.linear_max_m_s < math.inf and 0.0 < self.angular_max_rad_s < math.inf):
            raise ConfigError(
                f"a twist map takes speeds above 0, got {self.linear_max_m_s:g} m/s and "
                f"{self.angular_max_rad_s:g} rad/s."
            )

    @property
    def _limits(self) -> Float[np.ndarray, " 6"]:
        return np.repeat([self.linear_max_m_s, self.angular_max_rad_s], 3)

    def twist(self, counts: Int64[np.ndarray, " 6"]) -> Float[np.ndarray, " 6"]:
        """Twist [m/s, rad/s] that axis counts stand for."""
        share = np.clip(counts / self.full_scale_counts, -1.0, 1.0)
        past = np.maximum(np.abs(share) - self.deadzone, 0.0) / (1.0 - self.deadzone)
        return np.sign(share) * past * self._limits

    def counts(self, twist: Float[np.ndarray, " 6"]) -> Int64[np.ndarray, " 6"]:
        """Axis counts, whole and within the full scale, whose twist is nearest to `twist`."""
        past = np.clip(np.abs(twist) / self._limits, 0.0, 1.0)
        share = np.where(past > 0.0, self.deadzone + past * (1.0 - self.deadzone), 0.0)
        return np.rint(np.sign(twist) * share * self.full_scale_counts).astype(np.int64)
