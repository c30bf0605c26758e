"""Connector insertion by feel: stands on the socket, goes and turns where the moment says, and snaps in gently."""

import math

# Numbers of the task's phases.
import numpy as np

from wrenchflow.collect.skills.skill import approach, press_lead
from wrenchflow.compiled import kernel

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
    "press_step_n": 3.0,
    "search_margin_m": 0.0008,
    "lever_x_m": 0.002,
    "lever_y_m": 0.0012,
    "turn_margin_rad": 0.012,
    "turn_moment_nm": 0.020,
    "walk_margin_m": 0.0014,
    "pitch_m": 0.0012,
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

    The plug stands on that side of its rim that is beside the socket, so its centre of pressure says where not to go.
    Turned too far, it meets chamfers with opposite corners, and they turn it back.
    """
    depth, press = seen.x[2], seen.wrench[2]
    yaw = math.atan2(seen.R[1, 0], seen.R[0, 0])
    wanted.turn[0] = wanted.turn[1] = 0.0
    # Where the chamfers and walls would have it turned; M is what the robot exerts, so away from it.
    wanted.turn[2] = yaw - skill.turn_margin_rad * _share(seen.wrench_slow[5], skill.turn_moment_nm)
    if depth > skill.inside_m:
        wanted.x[0], wanted.x[1] = seen.x[0], seen.x[1]  # The walls centre it.
        if depth > skill.seated_m:
            wanted.x[2] = depth + skill.hold_n / skill.K_lin
        else:
            push = min(skill.insert_m_s * skill.lag_s * skill.K_lin + skill.push_gain * max(press, 0.0), skill.push_n)
            wanted.x[2] = depth + max(min(push, _room(skill, seen)), 0.0) / skill.K_lin
        wanted.phase = SNAP if depth > skill.snap_m else INSERT
        return
    if press <= skill.touch_n or depth <= -skill.near_m:
        if depth <= -skill.near_m:
            wanted.phase = APPROACH if approach(skill, seen, wanted, 0.0, 0.0) else LAND
            return
        # So near to the socket, what was found by feel is kept: straight down.
        wanted.x[0], wanted.x[1] = seen.x[0], seen.x[1]
        wanted.x[2] = depth + skill.landing_m_s * skill.lag_s
        wanted.turn[2] = yaw
        wanted.phase = LAND
        return
    # The centre of pressure is at (-M_y, M_x) / F.
    firm = max(seen.wrench_slow[2], skill.press_step_n)
    along_x = _share(seen.wrench_slow[4], firm * skill.lever_x_m)
    along_y = -_share(seen.wrench_slow[3], firm * skill.lever_y_m)
    # Friction holds the tip until the target leads by mu F / K; the margin is what moves the plug.
    lead = skill.friction * press / skill.K_lin + skill.search_margin_m
    wanted.x[0] = seen.x[0] + lead * along_x
    wanted.x[1] = seen.x[1] + lead * along_y
    wanted.x[2] = depth + press_lead(skill, skill.press_n, press)
    wanted.phase = SEARCH


@kernel
def _share(value, full):
    return min(max(value / full, -1.0), 1.0)


@kernel
def _room(skill, seen):
    """How hard it may push before the force, with what presses sideways, comes near the limit [N]."""
    f = seen.wrench
    sideways = math.sqrt(f[0] * f[0] + f[1] * f[1])
    return skill.force_limit_n - sideways
