"""The scripted operator for peg insertion: approaches, touches, searches by feel, inserts. It remembers nothing.

Target = pose + f(pose, wrench): whoever sees the same pose and wrench can do the same, so a policy can learn it. An
operator that integrates a hidden reference teaches policies that land hard.
"""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from wrenchflow.collect.operator import Perception
from wrenchflow.control.config import Impedance
from wrenchflow.spatial import log_so3, rotation_of


@dataclass(frozen=True, kw_only=True)
class PegByFeel:
    """Finds the hole by the moment that the rim of the block makes about the tip.

    The peg stands on the block on the side away from the hole. With m the moment of the environment on the tool about
    the tip, the hole lies along (m_y, -m_x) / |m|. Beyond about 4 mm there is no moment, and the peg walks outward on
    a spiral until there is.
    """

    impedance: Impedance
    lag_s: float = 0.2  # D / K: how far behind its target the arm follows
    approach_m_s: float = 0.08
    landing_m_s: float = 0.010
    slowing_per_s: float = 1.6  # approach speed a metre of height
    hover_m: float = 0.004
    level_rad: float = 0.002
    centred_m: float = 0.001
    press_n: float = 8.0
    press_step_n: float = 3.0
    touch_n: float = 1.0
    friction: float = 0.2
    search_margin_m: float = 0.0007
    walk_margin_m: float = 0.002
    moment_min_nm: float = 0.006
    spiral_pitch_m: float = 0.004
    inside_m: float = 0.0006
    insert_m_s: float = 0.04

    def want(self, perception: Perception) -> tuple[Float[np.ndarray, " 7"], str]:
        """The wanted target pose, and the phase: approach, land, search or insert."""
        tip_m, goal_m = perception.tcp_pose[:3], perception.goal_pose[:3]
        height_m = tip_m[2] - goal_m[2]
        aside_m = goal_m[:2] - tip_m[:2]
        press_n = -perception.wrench[2]
        wanted = np.concatenate([tip_m, perception.goal_pose[3:]])
        if height_m < -self.inside_m:
            wanted[2] -= self.insert_m_s * self.lag_s
            return wanted, "insert"
        if press_n > self.touch_n and height_m < self.hover_m:
            wanted[:2] += self._search(perception, -aside_m, press_n)
            wanted[2] -= min(self.press_n, max(press_n, 0.0) + self.press_step_n) / self.impedance.translation_n_m
            return wanted, "search"
        wanted[:2] += _shortened(aside_m, self.approach_m_s * self.lag_s)
        turn = log_so3(rotation_of(perception.goal_pose[3:]) @ rotation_of(perception.tcp_pose[3:]).T)
        # The lowest height that is allowed sinks from the hover to the block as the peg gets level and centred.
        unready = max(float(np.linalg.norm(turn)) / self.level_rad, float(np.linalg.norm(aside_m)) / self.centred_m)
        floor_m = self.hover_m * min(max(unready - 1.0, 0.0), 1.0)
        speed_m_s = min(self.approach_m_s, self.slowing_per_s * max(height_m - self.hover_m, 0.0) + self.landing_m_s)
        wanted[2] = max(
            tip_m[2] - speed_m_s * self.lag_s, min(goal_m[2] + floor_m, tip_m[2]) - self.landing_m_s * self.lag_s
        )
        return wanted, "approach" if height_m > self.hover_m else "land"

    def _search(self, perception: Perception, from_goal_m: Float[np.ndarray, " 2"], press_n: float) -> np.ndarray:
        # The wrench is what the robot exerts, so the environment's moment is its negative.
        moment = -perception.wrench_mean[3:5]
        strength_nm = float(np.linalg.norm(moment))
        if strength_nm > self.moment_min_nm:
            direction, margin_m = np.array([moment[1], -moment[0]]) / strength_nm, self.search_margin_m
        else:
            radius_m = max(float(np.linalg.norm(from_goal_m)), 1e-4)
            outward = from_goal_m / radius_m
            around = np.array([-outward[1], outward[0]])
            spiral = around + outward * self.spiral_pitch_m / (2.0 * math.pi * radius_m)
            # Without a moment the hole is far, and nothing can be overrun.
            direction, margin_m = spiral / np.linalg.norm(spiral), self.walk_margin_m
        # Friction holds the tip until the target leads by mu F / K; the margin is what moves the peg.
        lead_m = self.friction * press_n / self.impedance.translation_n_m + margin_m
        return direction * lead_m


def _shortened(vector: np.ndarray, longest: float) -> np.ndarray:
    length = float(np.linalg.norm(vector))
    return vector * (longest / length) if length > longest else vector
