"""Surface wiping by feel: lands before the way begins, presses, and follows the way while the press is right."""

import math

import numpy as np

from wrenchflow.collect.skills.skill import approach, press_lead, stay_level
from wrenchflow.compiled import kernel
from wrenchflow.sim.tasks.wiping_path import BEGIN_M, END_M, aside, slope

# Numbers of the task's phases.
APPROACH, LAND, PRESS, WIPE = np.int64(0), np.int64(1), np.int64(2), np.int64(3)
TRAITS = {
    "lag_s": 0.2,
    "friction": 0.3,
    "speed_m_s": 0.10,
    "landing_m_s": 0.015,
    "slowing": 2.0,
    "hover_m": 0.012,
    "level_rad": 0.004,
    "centred_m": 0.003,
    "touch_n": 1.0,
    "press_n": 8.0,
    "press_taste": 0.08,
    "press_step_n": 3.0,
    "wipe_m_s": 0.035,
    "press_gain": 0.5,
    "uneven_n": 4.0,
}
_RUN_OUT_M = 0.02  # The way is followed so far beyond its end, so that it is not left at a crawl.


@kernel
def want(skill, seen, wanted):
    """Where the target should be, into `wanted`.

    Without contact the tool lands where it is on the way, or at the beginning of the run-in. In contact its place along
    the way says where to go next, and the press how fast.
    """
    along, press = seen.x[0], seen.wrench[2]
    if press <= skill.touch_n:
        aim = 0.0 if along < BEGIN_M else min(along, END_M)
        wanted.phase = APPROACH if approach(skill, seen, wanted, aim, aside(aim)) else LAND
        return
    wrong = skill.press_n - press
    ready = min(max(1.0 - abs(wrong) / skill.uneven_n, 0.0), 1.0)
    # Friction holds the tip until the target leads by mu F / K; what is more moves the tool. The lead is along the way,
    # whose place across is a fixed one, so that whoever sees late is slow but not beside it.
    lead = skill.friction * press / skill.K_lin + ready * skill.wipe_m_s * skill.lag_s
    swing = slope(along + 0.5 * lead)
    ahead = min(along + lead / math.sqrt(1.0 + swing * swing), END_M + _RUN_OUT_M)
    wanted.x[0], wanted.x[1] = ahead, aside(ahead)
    wanted.x[2] = seen.x[2] + press_lead(skill, skill.press_n, press) + skill.press_gain * wrong / skill.K_lin
    stay_level(wanted)
    wanted.phase = WIPE if along >= BEGIN_M else PRESS
