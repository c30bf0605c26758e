"""What a person does with a task, as compiled code: what is perceived goes in, where the target should be comes out.

A skill remembers nothing. Its target is a function of the pose and the wrench, so that whoever sees both can learn it;
an operator that keeps a hidden reference shows a policy actions that do not follow from what the policy sees. What a
person adds to a skill (delay, tremor, a slow hand) is the hand's, `collect.hand`.
"""

import math

import numpy as np

from wrenchflow.compiled import kernel
from wrenchflow.control.records import record_dtype

# What a person perceives, in the goal's axes, whose z points into the surface. The wrench is what the robot exerts.
PERCEIVED = record_dtype(
    [
        ("x", "f8", 3),  # TCP from the perceived goal [m]
        ("R", "f8", (3, 3)),  # of the TCP in the goal's axes
        ("wrench", "f8", 6),  # about the TCP, low-passed at 50 Hz [N, N.m]
        ("wrench_slow", "f8", 6),  # the same, low-passed over `slow_s`
    ]
)

# Where the target should be, in the goal's axes.
WANTED = record_dtype(
    [
        ("x", "f8", 3),
        ("turn", "f8", 3),  # rotation vector from the goal's axes to the wanted ones [rad]
        ("phase", "i8"),  # of the task's `phases`
        ("is_reach", "i8"),  # the way there is free, so a person goes to `aim` in one movement
        ("aim", "f8", 3),
        ("vector", "f8", 3),  # what a skill works with
    ]
)

# How somebody does it. What a task does not need it does not read.
SKILL = record_dtype(
    [
        ("K_lin", "f8"),  # stiffness that the target is followed with [N/m]
        ("K_rot", "f8"),  # [N.m/rad]
        ("lag_s", "f8"),  # by which the arm follows its target, D / K
        ("friction", "f8"),
        # Getting there.
        ("speed_m_s", "f8"),
        ("landing_m_s", "f8"),
        ("slowing", "f8"),  # speed a metre of height [1/s]
        ("hover_m", "f8"),
        ("level_rad", "f8"),  # the tool waits above the goal until it is as level
        ("centred_m", "f8"),  # and as well centred as this
        # In contact.
        ("touch_n", "f8"),  # contact is felt from here on
        ("press_n", "f8"),
        ("press_taste", "f8"),  # how far people press as they like, 1, or as the task demands, 0
        ("press_step_n", "f8"),  # how far the wanted press may be ahead of the felt one
        ("search_margin_m", "f8"),  # lead over what friction holds, where the wrench says where to go
        ("walk_margin_m", "f8"),  # and where it does not
        ("moment_min_nm", "f8"),  # below this it does not
        ("pitch_m", "f8"),  # of the spiral that is walked then
        ("inside_m", "f8"),  # so deep the tool is in
        ("insert_m_s", "f8"),
        # Along a way.
        ("wipe_m_s", "f8"),
        ("press_gain", "f8"),  # share of a wrong press that is put right at once
        ("uneven_n", "f8"),  # a press that is as wrong stops the tool
        # A plug.
        ("near_m", "f8"),  # so low above the goal, place and turn are kept
        ("lever_x_m", "f8"),  # distance of the centre of pressure from which on it is followed as fast as may be
        ("lever_y_m", "f8"),
        ("turn_margin_rad", "f8"),  # lead of the turn
        ("turn_moment_nm", "f8"),  # moment from which on it is turned as fast as may be
        ("snap_m", "f8"),  # so deep the latch begins
        ("push_n", "f8"),  # over the latch, at most
        ("push_gain", "f8"),  # push that is wanted for each newton that is felt
        ("seated_m", "f8"),
        ("hold_n", "f8"),  # press of a tool that is seated
        ("force_limit_n", "f8"),  # never to be wanted, all directions together
    ]
)


@kernel
def approach(skill, seen, wanted, aim_x, aim_y):
    """Want the tool over a place of the goal's plane: down a funnel, hovering until level and centred, landing slowly.

    A speed is asked for as a lead of speed times lag. Returns whether the tool is higher than the hover.
    """
    height = -seen.x[2]
    aside_x, aside_y = aim_x - seen.x[0], aim_y - seen.x[1]
    aside = math.sqrt(aside_x * aside_x + aside_y * aside_y)
    share = min(1.0, skill.speed_m_s * skill.lag_s / max(aside, 1e-9))
    wanted.x[0] = seen.x[0] + share * aside_x
    wanted.x[1] = seen.x[1] + share * aside_y
    # The lowest height that is allowed sinks from the hover to the goal as the tool gets level and centred.
    unready = max(tilt(seen.R) / skill.level_rad, aside / skill.centred_m)
    floor = skill.hover_m * min(max(unready - 1.0, 0.0), 1.0)
    speed = min(skill.speed_m_s, skill.slowing * max(height - skill.hover_m, 0.0) + skill.landing_m_s)
    lowest = min(floor, height) - skill.landing_m_s * skill.lag_s
    wanted.x[2] = -max(height - speed * skill.lag_s, lowest)
    stay_level(wanted)
    wanted.is_reach = height > skill.hover_m
    wanted.aim[0], wanted.aim[1], wanted.aim[2] = aim_x, aim_y, -0.5 * skill.hover_m
    return height > skill.hover_m


@kernel
def stay_level(wanted):
    """Want the goal's own axes."""
    for i in range(3):
        wanted.turn[i] = 0.0


@kernel
def tilt(R):
    """Angle [rad] of a rotation: how far a tool is turned from the goal's axes."""
    return math.acos(min(max(0.5 * (R[0, 0] + R[1, 1] + R[2, 2] - 1.0), -1.0), 1.0))


@kernel
def press_lead(skill, press_n, felt_n):
    """How far the target goes into the surface for a press that rises with the one that is felt [m]."""
    return min(press_n, felt_n + skill.press_step_n) / skill.K_lin


def make_skill(impedance, **traits: float) -> np.ndarray:
    """A `SKILL` record. Shape (1,).

    Args:
        impedance: How stiffly the target is followed.
        **traits: Values by field name; a field that is not named stays 0.
    """
    skill = np.zeros(1, SKILL)
    skill["K_lin"], skill["K_rot"] = impedance.translation_n_m, impedance.rotation_nm_rad
    for name, value in traits.items():
        skill[name] = value
    return skill
