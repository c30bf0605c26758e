"""Connector insertion by feel: stands on the socket, goes and turns where the moment says, and snaps in gently."""

import math

import numpy as np

from wrenchflow.collect.skills.skill import approach, press_lead, stay_level
from wrenchflow.compiled import kernel

# Numbers of the task's phases.
APPROACH, LAND, SEARCH, INSERT, SNAP = np.int64(0), np.int64(1), np.int64(2), np.int64(3), np.int64(4)
TRAITS = {
    "lag_s": 0.2,
    "friction": 0.2,
    "speed_m_s": 0.08,
    "landing_m_s": 0.010,
    "slowing": 1.6,
    "hover_m": 0.004,
    "near_m": 0.0015,
    "level_rad": 0.004,
    "centred_m": 0.0008,
    "touch_n": 1.0,
    "press_n": 5.0,
    "press_taste": 0.5,
    "press_step_n": 3.0,
    "search_margin_m": 0.0008,
    "lever_x_m": 0.002,
    "lever_y_m": 0.0012,
    "turn_margin_rad": 0.012,
    "turn_moment_nm": 0.020,
    "inside_m": 0.0013,
    "insert_m_s": 0.012,
    "snap_m": 0.0045,
    "push_n": 18.0,
    "push_gain": 1.5,
    "seated_m": 0.0064,
    "hold_n": 5.0,
    "force_limit_n": 26.0,
}


@kernel
def want(skill, seen, wanted):
    """Where the target should be, into `wanted`.

    The plug stands with that side of its rim on the socket's flat that is beside the mouth, so its centre of pressure
    says where not to go. Turned too far, two opposite corners meet chamfers, whose moment about the plug's axis is 20
    to 70 mN.m at 5 N. On the flat there is none, and none is needed: the chamfers catch turns of up to 8 degrees.
    """
    depth, press = seen.x[2], seen.wrench[2]
    yaw = math.atan2(seen.R[1, 0], seen.R[0, 0])
    if depth <= -skill.near_m:
        wanted.phase = APPROACH if approach(skill, seen, wanted, 0.0, 0.0) else LAND
        return
    wanted.x[0], wanted.x[1] = seen.x[0], seen.x[1]
    stay_level(wanted)
    wanted.turn[2] = yaw
    if press <= skill.touch_n and depth <= skill.inside_m:
        # So near to the socket, what was found by feel is kept: straight down.
        wanted.x[2] = depth + skill.landing_m_s * skill.lag_s
        wanted.phase = LAND
        return
    # To where chamfers and walls would turn it; M is what the robot exerts, so away from it.
    wanted.turn[2] -= skill.turn_margin_rad * _share(seen.wrench_slow[5], skill.turn_moment_nm)
    if depth > skill.inside_m:
        wanted.x[2] = depth + _push(skill, seen) / skill.K_lin  # Sideways the walls centre it.
        wanted.phase = SNAP if depth > skill.snap_m else INSERT
        return
    # The centre of pressure is at (-M_y, M_x) / F. Friction holds the tip until the target leads by mu F / K; the
    # margin is what moves the plug, at 4 mm/s, for it must not be past the socket before that is felt.
    firm = max(seen.wrench_slow[2], skill.press_step_n)
    lead = skill.friction * press / skill.K_lin + skill.search_margin_m
    wanted.x[0] += lead * _share(seen.wrench_slow[4], firm * skill.lever_x_m)
    wanted.x[1] -= lead * _share(seen.wrench_slow[3], firm * skill.lever_y_m)
    wanted.x[2] = depth + press_lead(skill, skill.press_n, press)
    wanted.phase = SEARCH


@kernel
def _push(skill, seen):
    """How hard to push a plug that is in [N]: ever harder against what is felt, and gently as soon as it gives."""
    if seen.x[2] > skill.seated_m:
        return skill.hold_n
    f = seen.wrench
    push = skill.insert_m_s * skill.lag_s * skill.K_lin + skill.push_gain * max(f[2], 0.0)
    # What presses sideways counts towards the limit, too.
    room = skill.force_limit_n - math.sqrt(f[0] * f[0] + f[1] * f[1])
    return max(min(push, skill.push_n, room), 0.0)


@kernel
def _share(value, full):
    """How much of `full` something is, from -1 to 1."""
    return min(max(value / full, -1.0), 1.0)
