"""People with something on their mind that nobody can see: planted, so that a test of hidden state sees some."""

from collections.abc import Callable
from unittest.mock import patch

import numpy as np

from wrenchflow.collect import operators_table
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.follow import Follower
from wrenchflow.collect.hand_driver import HandDriver
from wrenchflow.collect.session import demonstrate
from wrenchflow.episode import Episode
from wrenchflow.sim.attempt import Attempt


class Whimsical(HandDriver):
    """Presses now with little force and now with much, and changes its mind every 0.2 to 0.6 s."""

    def __init__(self, attempt: Attempt, hand: np.ndarray, periods: np.ndarray) -> None:
        """As any hand, with a mind of its own."""
        super().__init__(attempt, hand, periods)
        self._rng, self._left = np.random.default_rng(attempt.seed), 0

    def driving(self, follower: Follower) -> Callable[..., None]:
        """As that of any hand; the mind changes between stretches, of 40 ms each."""
        drive, usual_n = super().driving(follower), float(self._hand[0]["skill"]["press_n"])

        def driven(*arguments: object) -> None:
            self._left -= 1
            if self._left < 0:
                self._left = int(self._rng.integers(5, 15))
                self._hand["skill"]["press_n"] = usual_n * self._rng.choice([0.3, 1.7])
            drive(*arguments)

        return driven


def demonstrate_on_a_whim(index: int, config: CollectConfig) -> Episode:
    """Record a demonstration of a `Whimsical` person."""
    with patch.object(operators_table, "HandDriver", Whimsical):
        return demonstrate(index, config)
