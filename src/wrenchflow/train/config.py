"""How a policy is trained. Free of torch, so that the command line can show it without loading a network."""

from dataclasses import dataclass, field
from typing import Literal

from wrenchflow.config import require_at_least, require_positive
from wrenchflow.errors import ConfigError
from wrenchflow.policy.config import PolicyConfig


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """How a policy is trained.

    Attributes:
        policy: What it is made of.
        features: What it sees: everything, or nothing that force leaks into.
        steps: Updates.
        batch_size: Windows an update.
        learning_rate: Largest rate, reached after the warm-up; a half cosine leads from there to zero.
        warmup_steps: Updates over which the rate rises from zero.
        weight_decay: Of AdamW.
        ema_power: The weights that are kept average over the last updates: after n updates the old average counts
            1 - n ** -ema_power.
        ema_max_decay: The most that the old average counts.
        valid_fraction: Share of the episodes that is held out, to watch the loss on: whole episodes, and those that the
            data set's own split names if it was made with the same share.
        metrics_every: Updates between rows of metrics.
        seed: Same seed, same weights, bit for bit on one machine with one number of threads.
        threads: Threads that torch may use.
    """

    policy: PolicyConfig = field(default_factory=PolicyConfig)
    features: Literal["with_force", "without_force"] = "with_force"
    steps: int = 6_000
    batch_size: int = 256
    learning_rate: float = 1e-3
    warmup_steps: int = 500
    weight_decay: float = 1e-6
    ema_power: float = 0.75
    ema_max_decay: float = 0.9999
    valid_fraction: float = 0.1
    metrics_every: int = 500
    seed: int = 0
    threads: int = 2

    def __post_init__(self) -> None:
        require_at_least(
            1, steps=self.steps, batch_size=self.batch_size, metrics_every=self.metrics_every, threads=self.threads
        )
        require_at_least(0, warmup_steps=self.warmup_steps, weight_decay=self.weight_decay, seed=self.seed)
        require_at_least(0, ema_power=self.ema_power)
        require_positive(learning_rate=self.learning_rate)
        for name, most in (("batch_size", 1 << 16), ("threads", 256)):
            if getattr(self, name) > most:
                raise ConfigError(f"{name} is {getattr(self, name)}, expected at most {most}.")
        for name in ("valid_fraction", "ema_max_decay"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise ConfigError(f"{name} is {getattr(self, name)}, expected from 0 to below 1.")
