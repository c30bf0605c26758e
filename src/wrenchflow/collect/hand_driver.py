"""The emulated person as a driver: the compiled hand, a period at a time, or many where nothing else has to happen."""

from collections.abc import Callable
from typing import Any

import numpy as np

from wrenchflow.collect.chance import Chance
from wrenchflow.collect.devices.emulated_spacemouse import FULL_SCALE_COUNTS
from wrenchflow.collect.follow import Follower
from wrenchflow.collect.hand_loop import decide, drive
from wrenchflow.sim.attempt import Attempt
from wrenchflow.spatial import rotation_of


def stand_before(attempt: Attempt, hand: np.ndarray, periods: int) -> Chance:
    """Show a hand where the goal seems to be; returns the chance that it will meet."""
    goal = attempt.scene.T_base_goal_perceived
    hand["goal_x"], hand["goal_R"] = goal[:3], rotation_of(goal[3:])
    return Chance(attempt.rng, periods)


class HandDriver:
    """A hand at the emulated SpaceMouse."""

    full_scale_counts = FULL_SCALE_COUNTS

    def __init__(self, attempt: Attempt, hand: np.ndarray, periods: np.ndarray) -> None:
        """Put a hand before an arm.

        Args:
            attempt: Tared.
            hand: Who it is, one `HAND` record. Shape (1,); what goes on in it is kept here.
            periods: Where periods are noted, `PERIOD` records.
        """
        self._hand, self._periods = hand, periods
        self._chance = stand_before(attempt, hand, len(periods))

    def decide(self, attempt: Attempt, follower: Follower, now_ns: int) -> int:
        """One period: see, feel, decide, deflect."""
        core = attempt.controller
        white = self._chance.up_to(int(self._hand[0]["period"]) + 1)
        decide(self._hand, white, follower.record, core.obs, core.req, core.ctl)
        return int(self._hand[0]["wanted"]["phase"])

    def look_back(self, attempt: Attempt, first: int) -> None:
        """The hand feels by itself."""

    def driving(self, follower: Follower) -> Callable[..., None]:
        """What `Attempt.follow` may be given in place of the bare loop, to run many periods at once."""
        ticks = int(follower.record[0]["ticks"])

        def run(*simulation: Any) -> None:
            white = self._chance.up_to(int(self._hand[0]["period"]) + simulation[-1] // ticks)
            drive(self._hand, white, follower.record, self._periods, *simulation)

        return run
