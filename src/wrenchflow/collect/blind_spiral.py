"""The baseline that feels nothing: lands at the perceived hole, presses, and spirals outward until the peg drops."""

import math

import numpy as np
from jaxtyping import Float

from wrenchflow.collect.approach import Approach
from wrenchflow.collect.operators import Perception
from wrenchflow.control.config import Impedance


class BlindSpiral:
    """A spiral search at constant press, as it is done where force is not measured; it may remember how far it got.

    The turns lie closer than the capture diameter, so that none can miss the hole, and the path is led by what friction
    and the arm's lag hold back: this is meant to be a baseline that is hard to beat.
    """

    def __init__(
        self,
        impedance: Impedance,
        *,
        period_s: float,
        approach: Approach | None = None,
        press_n: float = 8.0,
        friction: float = 0.2,
        speed_m_s: float = 0.009,
        pitch_m: float = 0.0012,
        dwell_s: float = 0.4,
        target_m_s: float = 0.04,
    ) -> None:
        """Prepare for one attempt.

        Args:
            impedance: How stiffly the target is followed.
            period_s: Time between calls of `want`.
            approach: How to get there.
            press_n: Press while searching [N].
            friction: Of the peg on the block.
            speed_m_s: Along the spiral.
            pitch_m: Distance of its turns.
            dwell_s: How long it presses before it begins: near contact the reference is slow, and a peg that goes
                round before it presses passes over the hole.
            target_m_s: How fast the target may go: it runs ahead of the peg, so that in the first turn, where the
                direction changes most, it goes faster than the peg. Below what control allows near contact.
        """
        self._approach = approach or Approach()
        self._period_s, self._speed_m_s, self._pitch_m = period_s, speed_m_s, pitch_m
        self._press_m = press_n / impedance.translation_n_m
        self._lead_m = friction * press_n / impedance.translation_n_m + speed_m_s * self._approach.lag_s
        self._target_m_s = target_m_s
        self._angle_rad = 0.0
        self._dwell_left_s = dwell_s

    def want(self, perception: Perception) -> tuple[Float[np.ndarray, " 7"], str]:
        """The wanted target pose, and the phase: approach, land, search or insert."""
        height_m = perception.tcp_pose[2] - perception.goal_pose[2]
        if height_m < -0.0006:
            return insert(perception, 0.04 * self._approach.lag_s), "insert"
        if height_m > 0.0004 and self._angle_rad == 0.0:
            return self._approach.want(perception)
        if self._dwell_left_s > 0.0:
            self._dwell_left_s -= self._period_s
            pressed = perception.goal_pose.copy()
            pressed[2] -= self._press_m
            return pressed, "search"
        growth_m = self._pitch_m / (2.0 * math.pi)
        radius_m = growth_m * self._angle_rad
        turning_rad_s = min(
            self._speed_m_s / math.hypot(radius_m, growth_m), self._target_m_s / math.hypot(radius_m, self._lead_m)
        )
        self._angle_rad += turning_rad_s * self._period_s
        cos, sin = math.cos(self._angle_rad), math.sin(self._angle_rad)
        along = np.array([growth_m * cos - radius_m * sin, growth_m * sin + radius_m * cos])
        along /= math.hypot(*along)
        wanted = np.concatenate([perception.goal_pose[:3], perception.goal_pose[3:]])
        wanted[:2] += radius_m * np.array([cos, sin]) + self._lead_m * along
        wanted[2] -= self._press_m
        return wanted, "search"


def insert(perception: Perception, lead_m: float) -> Float[np.ndarray, " 7"]:
    """A target straight down the hole: sideways it is where the peg is, so that the walls may centre it."""
    wanted = np.concatenate([perception.tcp_pose[:3], perception.goal_pose[3:]])
    wanted[2] -= lead_m
    return wanted
