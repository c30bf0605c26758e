"""How packets get from a policy to the arm; loads nothing heavy, so that the command line can show it at once."""

import math
from dataclasses import dataclass

from wrenchflow.config import require_at_least
from wrenchflow.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class Link:
    """How long a packet takes, and how likely it is lost.

    It takes `latency_s + jitter_s * |n|`, n standard normal: never less than the latency, seldom much more, as
    inference and networks do.

    Attributes:
        latency_s: The least time [s].
        jitter_s: Scale of what comes on top [s]: 0.67 of it in the median, under 1.96 of it in 95 %.
        loss: Share of packets that never arrive.
    """

    latency_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0

    def __post_init__(self) -> None:
        require_at_least(0, latency_s=self.latency_s, jitter_s=self.jitter_s, loss=self.loss)
        for name in ("latency_s", "jitter_s"):
            if math.isinf(getattr(self, name)):
                raise ConfigError(f"{name} is inf, expected a number; what never arrives is a loss of 1.")
        if self.loss > 1.0:
            raise ConfigError(f"loss is {self.loss:g}, expected from 0 to 1.")
