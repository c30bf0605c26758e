"""What a person may set about `split`; loads nothing heavy, so that the command line can show it at once."""

from dataclasses import dataclass
from typing import Literal

from wrenchflow.config import require_between
from wrenchflow.errors import ConfigError

SPLITS = ("train", "valid", "test")


@dataclass(frozen=True, kw_only=True)
class SplitConfig:
    """How a selection is divided.

    Attributes:
        train: Share that trains.
        valid: Share that validates.
        test: Share that is kept for a last look.
        by: What stays together: a demonstration (all that was made of one raw recording), or all of an operator.
        stratify: What each side gets its share of: `task`, `success`, `operator`.
        seed: Another seed, another division.
    """

    train: float = 0.8
    valid: float = 0.1
    test: float = 0.1
    by: Literal["demonstration", "operator"] = "demonstration"
    stratify: tuple[str, ...] = ("task", "success")
    seed: int = 0

    def __post_init__(self) -> None:
        require_between(0.0, 1.0, train=self.train, valid=self.valid, test=self.test)
        if abs(self.train + self.valid + self.test - 1.0) > 1e-9:
            raise ConfigError(f"shares are {self.train:g}, {self.valid:g} and {self.test:g}, expected a sum of 1.")
        for name in self.stratify:
            if name not in ("task", "success", "operator"):
                raise ConfigError(f"stratify names '{name}', expected some of task, success, operator.")
