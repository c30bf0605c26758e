"""What a person may set about `quickstart`; loads nothing heavy, so that the command line can show it at once."""

from dataclasses import dataclass

from wrenchflow.config import require_at_least

TASK = "peg-insertion"


@dataclass(frozen=True, kw_only=True)
class QuickstartConfig:
    """How much of everything.

    Attributes:
        seed: Every random number comes from it.
        episodes: Demonstrations.
        train_steps: Updates of each of the two policies.
        rollouts: Attempts of each policy and of the baseline, on the same scenes.
    """

    seed: int = 0
    episodes: int = 200
    train_steps: int = 6_000
    rollouts: int = 200

    def __post_init__(self) -> None:
        require_at_least(2, episodes=self.episodes)
        require_at_least(1, train_steps=self.train_steps, rollouts=self.rollouts)
