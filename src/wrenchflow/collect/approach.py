"""Getting a tool over a goal, level and centred, and down to it gently; from the present pose alone."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wrenchflow.collect.operators import Perception
from wrenchflow.spatial import log_so3, rotation_of


@dataclass(frozen=True, kw_only=True)
class Approach:
    """Comes down along a funnel, hovers until the tool is level and centred, and lands slowly.

    The arm follows its target with a lag of about D / K, so a speed is asked for as a lead of speed times lag.
    """

    lag_s: float = 0.2
    speed_m_s: float = 0.08
    landing_m_s: float = 0.010
    slowing_per_s: float = 1.6  # speed a metre of height
    hover_m: float = 0.004
    level_rad: float = 0.002
    centred_m: float = 0.001

    def want(self, perception: Perception) -> tuple[Float[np.ndarray, " 7"], str]:
        """The wanted target pose, and the phase: approach or land."""
        tip_m, goal_m = perception.tcp_pose[:3], perception.goal_pose[:3]
        height_m, aside_m = tip_m[2] - goal_m[2], goal_m[:2] - tip_m[:2]
        aside = math.hypot(*aside_m)
        wanted = np.concatenate([tip_m, perception.goal_pose[3:]])
        wanted[:2] += aside_m * min(1.0, self.speed_m_s * self.lag_s / max(aside, 1e-9))
        turn = log_so3(rotation_of(perception.goal_pose[3:]) @ rotation_of(perception.tcp_pose[3:]).T)
        # The lowest height that is allowed sinks from the hover to the goal as the tool gets level and centred.
        unready = max(float(np.linalg.norm(turn)) / self.level_rad, aside / self.centred_m)
        floor_m = goal_m[2] + self.hover_m * min(max(unready - 1.0, 0.0), 1.0)
        speed_m_s = min(self.speed_m_s, self.slowing_per_s * max(height_m - self.hover_m, 0.0) + self.landing_m_s)
        landing_m = min(floor_m, tip_m[2]) - self.landing_m_s * self.lag_s
        wanted[2] = max(tip_m[2] - speed_m_s * self.lag_s, landing_m)
        return wanted, "approach" if height_m > self.hover_m else "land"
