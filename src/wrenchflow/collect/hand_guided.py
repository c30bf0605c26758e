"""Kinesthetic teaching: a virtual hand leads a compliant arm by its flange, and the reference goes where the arm goes.

With the reference at the arm, the impedance is no spring that the hand has to overcome, but damping, and what keeps the
arm in place when it is let go of. The hand holds the flange, upstream of the wrist sensor, so the wrench is that of the
contact.
"""

import numpy as np

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.devices.device import Reading
from wrenchflow.collect.follow import Follower, follow
from wrenchflow.collect.hand import operate
from wrenchflow.collect.hand_driver import stand_before
from wrenchflow.control.config import Impedance
from wrenchflow.control.records import CTL, REQ
from wrenchflow.sim.attempt import Attempt

# The arm and the wrist of whoever leads.
HAND_N_M, HAND_N_S_M, WRIST_NM_RAD, WRIST_NM_S_RAD = 450.0, 25.0, 18.0, 0.8
# Of the force that a landing tool comes to rest with, what is taken for a contact.
_TOUCH_SHARE = 0.7


class GuidingDriver:
    """A hand that leads the arm; no device is between them."""

    full_scale_counts = 1000  # What a hand can tell apart, where no device rounds it.

    def __init__(self, attempt: Attempt, hand: np.ndarray, config: CollectConfig, periods: int) -> None:
        """Take hold of an arm.

        Args:
            attempt: Tared.
            hand: Who it is, one `HAND` record whose skill reckons with the hand's own stiffness. Shape (1,).
            config: How fast a hand moves at most, by the map of devices.
            periods: How many there may be.
        """
        hand["skill"]["touch_n"] = np.minimum(hand["skill"]["touch_n"], _TOUCH_SHARE * _resting_n(hand["skill"]))
        self._hand, self._chance = hand, stand_before(attempt, hand, periods)
        ticks = round(1000 / config.device_hz)
        start = attempt.controller.target_pose
        # Where the hand is: it moves as the target of a device does.
        self._place = Follower(
            config.twist_map, config.impedance, start, full_scale_counts=self.full_scale_counts, ticks=ticks
        )
        self._place.record["deadzone"] = 0.0
        self._unused = np.zeros(1, REQ), np.zeros(1, CTL)

    def decide(self, attempt: Attempt, follower: Follower, now_ns: int) -> int:
        """Move the hand, and let the reference follow the arm."""
        core, place = attempt.controller, self._place
        period = int(self._hand[0]["period"])
        white = self._chance.up_to(period + 1)[period]
        operate(self._hand[0], core.obs[0], core.ctl[0], place.record[0], white)
        place.record["report_ns"], place.record["is_sound"] = now_ns, 1
        req, ctl = self._unused
        follow(place.record[0], now_ns, req[0], ctl[0])
        attempt.plant.hold(
            place.target_pose,
            stiffness_n_m=HAND_N_M,
            damping_n_s_m=HAND_N_S_M,
            stiffness_nm_rad=WRIST_NM_RAD,
            damping_nm_s_rad=WRIST_NM_S_RAD,
        )
        follower.take(Reading(t_ns=now_ns, pose=attempt.plant.recorded[-1]["tcp_pose"].copy()))
        follower.move(now_ns, core)
        return int(self._hand[0]["wanted"]["phase"])

    def look_back(self, attempt: Attempt, first: int) -> None:
        """The hand feels by itself."""


def _resting_n(skill: np.ndarray) -> np.ndarray:
    """Press of a tool that has landed, and on which nobody leans yet [N]: the lead of a landing on the hand's spring.

    The hand is softer than the arm would be. Whoever is slow rests with 0.6 N, and who waited for a newton of contact
    would stand there, and never begin to search.
    """
    return skill["K_lin"] * skill["landing_m_s"] * skill["lag_s"]


def led_by(config: CollectConfig) -> Impedance:
    """What stiffness a skill has to reckon with: the hand's."""
    return Impedance(
        translation_n_m=HAND_N_M, rotation_nm_rad=WRIST_NM_RAD, damping_ratio=config.impedance.damping_ratio
    )
