"""The scripted operator for peg insertion: approaches, touches, searches by feel, inserts. It remembers nothing.

Target = pose + f(pose, wrench): whoever sees the same pose and wrench can do the same, so a policy can learn it. An
operator that integrates a hidden reference teaches policies that land hard.
"""

import math
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from wrenchflow.collect.approach import Approach, spiral_direction
from wrenchflow.collect.operators import Perception
from wrenchflow.control.config import Impedance


@dataclass(frozen=True, kw_only=True)
class PegByFeel:
    """Finds the hole by the moment that the rim of the block makes about the tip.

    The peg stands on the block on the side away from the hole. With m the moment of the environment on the tool about
    the tip, the hole lies along (m_y, -m_x) / |m|. Beyond about 4 mm there is no moment, and the peg walks outward on
    a spiral until there is.
    """

    impedance: Impedance
    approach: Approach = field(default_factory=Approach)
    press_n: float = 8.0
    press_step_n: float = 3.0  # how far the wanted press may be ahead of the felt one
    touch_n: float = 1.0
    friction: float = 0.2
    search_margin_m: float = 0.0016
    walk_margin_m: float = 0.0025
    moment_min_nm: float = 0.006
    spiral_pitch_m: float = 0.004
    inside_m: float = 0.0006
    insert_m_s: float = 0.04

    def want(self, perception: Perception) -> tuple[Float[np.ndarray, " 7"], str]:
        """The wanted target pose, and the phase: approach, land, search or insert."""
        height_m = perception.tcp_pose[2] - perception.goal_pose[2]
        press_n = -perception.wrench[2]
        if height_m < -self.inside_m:
            return insert(perception, self.insert_m_s * self.approach.lag_s), "insert"
        if press_n <= self.touch_n or height_m >= self.approach.hover_m:
            return self.approach.want(perception)
        wanted = np.concatenate([perception.tcp_pose[:3], perception.goal_pose[3:]])
        wanted[:2] += self._lead(perception, press_n)
        wanted[2] -= min(self.press_n, press_n + self.press_step_n) / self.impedance.translation_n_m
        return wanted, "search"

    def _lead(self, perception: Perception, press_n: float) -> Float[np.ndarray, " 2"]:
        # The wrench is what the robot exerts, so the environment's moment is its negative.
        moment = -perception.wrench_mean[3:5]
        strength_nm = math.hypot(*moment)
        if strength_nm > self.moment_min_nm:
            direction, margin_m = np.array([moment[1], -moment[0]]) / strength_nm, self.search_margin_m
        else:
            # Without a moment the hole is far, and nothing can be overrun.
            from_goal_m = perception.tcp_pose[:2] - perception.goal_pose[:2]
            direction, margin_m = spiral_direction(from_goal_m, self.spiral_pitch_m), self.walk_margin_m
        # Friction holds the tip until the target leads by mu F / K; the margin is what moves the peg.
        return direction * (self.friction * press_n / self.impedance.translation_n_m + margin_m)


def insert(perception: Perception, lead_m: float) -> Float[np.ndarray, " 7"]:
    """A target straight down the hole: sideways it is where the peg is, so that the walls may centre it."""
    wanted = np.concatenate([perception.tcp_pose[:3], perception.goal_pose[3:]])
    wanted[2] -= lead_m
    return wanted
