"""Peg insertion by feel: lands beside the hole, goes where the moment of the rim says, and follows the hole down."""

import math

import numpy as np

from wrenchflow.collect.skills.skill import approach, press_lead, stay_level
from wrenchflow.compiled import kernel

# Numbers of the task's phases.
APPROACH, LAND, SEARCH, INSERT = np.int64(0), np.int64(1), np.int64(2), np.int64(3)
TRAITS = {
    "lag_s": 0.2,
    "friction": 0.2,
    "speed_m_s": 0.08,
    "landing_m_s": 0.010,
    "slowing": 1.6,
    "hover_m": 0.004,
    "level_rad": 0.002,
    "centred_m": 0.001,
    "touch_n": 1.0,
    "press_n": 8.0,
    "press_taste": 1.0,
    "press_step_n": 3.0,
    "search_margin_m": 0.0016,
    "walk_margin_m": 0.0025,
    "moment_min_nm": 0.006,
    "pitch_m": 0.004,
    "inside_m": 0.0006,
    "insert_m_s": 0.04,
}


@kernel
def want(skill, seen, wanted):
    """Where the target should be, into `wanted`.

    The peg stands on the block on the side away from the hole, so what it exerts there turns about the tip. Beyond
    about 4 mm there is no moment, and the peg walks outward on a spiral until there is.
    """
    depth, press = seen.x[2], seen.wrench[2]
    if depth > skill.inside_m:
        wanted.x[0], wanted.x[1] = seen.x[0], seen.x[1]  # The walls centre it.
        wanted.x[2] = depth + skill.insert_m_s * skill.lag_s
        stay_level(wanted)
        wanted.phase = INSERT
        return
    if press <= skill.touch_n or depth <= -skill.hover_m:
        wanted.phase = APPROACH if approach(skill, seen, wanted, 0.0, 0.0) else LAND
        return
    # With M the moment that the robot exerts, the hole lies along (M_y, -M_x).
    along_x, along_y = seen.wrench_slow[4], -seen.wrench_slow[3]
    strength = math.sqrt(along_x * along_x + along_y * along_y)
    margin = skill.search_margin_m
    if strength <= skill.moment_min_nm:
        # Without a moment the hole is far, and nothing can be overrun: outward, along a spiral about the goal.
        radius = math.sqrt(seen.x[0] * seen.x[0] + seen.x[1] * seen.x[1])
        out_x, out_y = 1.0, 0.0  # From the very middle any way is outward.
        if radius > 1e-4:
            out_x, out_y = seen.x[0] / radius, seen.x[1] / radius
        radius = max(radius, 1e-4)
        growth = skill.pitch_m / (2.0 * math.pi * radius)
        along_x, along_y = out_y + growth * out_x, -out_x + growth * out_y
        strength = math.sqrt(along_x * along_x + along_y * along_y)
        margin = skill.walk_margin_m
    # Friction holds the tip until the target leads by mu F / K; the margin is what moves the peg.
    lead = skill.friction * press / skill.K_lin + margin
    wanted.x[0] = seen.x[0] + lead * along_x / strength
    wanted.x[1] = seen.x[1] + lead * along_y / strength
    wanted.x[2] = depth + press_lead(skill, skill.press_n, press)
    stay_level(wanted)
    wanted.phase = SEARCH
