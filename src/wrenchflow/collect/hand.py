"""A person's hand on a SpaceMouse, compiled: it sees and feels late, moves in strokes, lags, leaks and trembles.

What the person wants is the skill's, which remembers nothing (`collect.skills`). The hand is what stands between that
and the bytes of a HID report. All of it is short memory, of some tenths of a second; nothing of it is a plan.

Sources of the figures: Flash, Hogan, *The coordination of arm movements* (1985), for minimum-jerk strokes; Fitts, *The
information capacity of the human motor system* (1954), for how long one takes; Harris, Wolpert, *Signal-dependent noise
determines motor planning* (1998); Elble, Koller, *Tremor* (1990), for 8 to 12 Hz.
"""

import math

import numpy as np

from wrenchflow.collect.devices.hid_report import WHOLE_BYTES, decode, encode_motion
from wrenchflow.collect.skills.decide import want
from wrenchflow.collect.skills.goal_axes import perceive_into, target_into
from wrenchflow.collect.skills.skill import PERCEIVED, SKILL, WANTED
from wrenchflow.compiled import kernel
from wrenchflow.control.records import record_dtype
from wrenchflow.so3 import log_into, multiply_transposed_into

MEMORY = np.int64(64)  # Periods that a delay may have.
WHITE_WIDTH = 6 + 12 + 6 + 3 + 3 + 3  # deflection, tremor, feeling, eye, stroke, disturbance of the arm

HAND = record_dtype(
    [
        # Who it is.
        ("task", "i8"),  # number of the skill
        ("skill", SKILL),
        ("delay_periods", "i8"),  # from seeing and feeling to moving
        ("slow_s", "f8"),  # over which a person judges a steady force
        ("grip_s", "f8"),  # in which what is off is put right: deflection is the error over this
        ("hand_s", "f8"),  # lag of the hand
        ("crosstalk", "f8", (6, 6)),  # of what is meant for axis j, the share that axis i gets besides
        ("motor_noise", "f8"),  # standard deviation of a deflection over its size
        ("motor_noise_s", "f8"),  # how long it is correlated
        ("tremor", "f8"),  # standard deviation, of full deflection
        ("tremor_hz", "f8"),
        ("feel_noise", "f8"),  # standard deviation of a felt force over its size
        ("eye_m", "f8"),  # of where the goal seems to be, besides the scene's own error
        ("drift_s", "f8"),  # how long eye and feeling err the same way
        ("stroke_s", "f8"),  # the shortest stroke
        ("stroke_s_bit", "f8"),  # Fitts: a bit of difficulty takes so much longer
        ("stroke_miss", "f8"),  # standard deviation of where a stroke ends over its length
        ("stroke_rest_s", "f8"),  # between two
        ("bow", "f8"),  # how far a stroke goes aside, over its length
        ("bow_way", "f8", 3),  # whereto, as far as it is across the stroke
        ("near_m", "f8"),  # nobody makes a stroke for less
        ("disturbance_m", "f8"),  # of the arm, not of the hand
        ("disturbance_s", "f8"),
        # What goes on in it.
        ("period", "i8"),
        ("x_seen", "f8", (MEMORY, 3)),
        ("R_seen", "f8", (MEMORY, 3, 3)),
        ("wrench_felt", "f8", (MEMORY, 12)),  # and the slow one
        ("wrench_slow", "f8", 6),
        ("eye", "f8", 3),
        ("feeling", "f8", 6),
        ("noise", "f8", 6),
        ("tremble", "f8", (6, 2)),
        ("deflection", "f8", 6),
        ("is_stroke", "i8"),
        ("strokes", "i8"),
        ("stroke_t", "f8"),  # into the stroke, or below 0 before the next may begin [s]
        ("stroke_T", "f8"),
        ("stroke_from", "f8", 3),
        ("stroke_to", "f8", 3),
        ("stroke_aside", "f8", 3),
        ("seen", PERCEIVED),
        ("wanted", WANTED),
        ("goal_x", "f8", 3),
        ("goal_R", "f8", (3, 3)),
        ("x", "f8", 3),  # where the target should be, base axes
        ("R", "f8", (3, 3)),
        ("physical", "f8", 6),  # deflection of the puck, of full scale
        ("counts", "i8", 6),
        ("report", "u1", WHOLE_BYTES),
        ("matrix", "f8", (3, 3)),
        ("vector", "f8", 4),
    ]
)


@kernel
def operate(hand, obs, ctl, teleop, white):
    """One report of the device: see, feel, decide, move the hand; the report's bytes are decoded into `teleop`.

    Args:
        hand: A `HAND` record.
        obs: An `OBS` record: where the arm is measured to be.
        ctl: A `CTL` record, for the wrench that is felt.
        teleop: A `TELEOP` record, for where the target is; gets what the device says.
        white: Standard normal numbers. Shape (WHITE_WIDTH,).
    """
    period_s = teleop.period_s
    _perceive(hand, obs, ctl, period_s, white)
    want(hand.task, hand.skill, hand.seen, hand.wanted)
    target_into(hand.wanted, hand.goal_x, hand.goal_R, hand.matrix, hand.x, hand.R)
    if hand.wanted.is_reach:
        _reach(hand, teleop, period_s, white)
    else:
        hand.is_stroke, hand.stroke_t = 0, 0.0
    _deflect(hand, teleop, period_s, white)
    encode_motion(hand.counts, hand.report)
    decode(hand.report, hand.report.size, teleop.counts, teleop.buttons)
    keep = math.exp(-period_s / hand.disturbance_s)
    fresh = hand.disturbance_m * math.sqrt(1.0 - keep * keep)
    for i in range(3):
        teleop.x_offset[i] = keep * teleop.x_offset[i] + fresh * white[30 + i]
    hand.period += 1


@kernel
def _perceive(hand, obs, ctl, period_s, white):
    now = hand.period % MEMORY
    share = min(period_s / hand.slow_s, 1.0)
    for i in range(3):
        hand.x_seen[now, i] = obs.x[i]
        for j in range(3):
            hand.R_seen[now, i, j] = obs.R[i, j]
    for a in range(6):
        hand.wrench_slow[a] += share * (ctl.wrench[a] - hand.wrench_slow[a])
        hand.wrench_felt[now, a], hand.wrench_felt[now, 6 + a] = ctl.wrench[a], hand.wrench_slow[a]
    then = (hand.period - min(hand.delay_periods, hand.period)) % MEMORY
    keep = math.exp(-period_s / hand.drift_s)
    fresh = math.sqrt(1.0 - keep * keep)
    for a in range(6):
        hand.feeling[a] = keep * hand.feeling[a] + fresh * hand.feel_noise * white[18 + a]
    for i in range(3):
        hand.eye[i] = keep * hand.eye[i] + fresh * hand.eye_m * white[24 + i]
        hand.vector[i] = hand.goal_x[i] + hand.eye[i]
    felt = hand.wrench_felt[then]
    perceive_into(hand.x_seen[then], hand.R_seen[then], felt[:6], felt[6:], hand.vector, hand.goal_R, hand.seen)
    for a in range(6):
        hand.seen.wrench[a] *= 1.0 + hand.feeling[a]
        hand.seen.wrench_slow[a] *= 1.0 + hand.feeling[a]


@kernel
def _reach(hand, teleop, period_s, white):
    """Go to the aim in minimum-jerk strokes; a stroke, once begun, is not changed."""
    if not hand.is_stroke:
        hand.stroke_t += period_s
        if hand.stroke_t < hand.stroke_rest_s and hand.strokes > 0:
            _stay(hand, teleop)
            return
        far = 0.0
        for i in range(3):
            aim = hand.goal_x[i]
            for k in range(3):
                aim += hand.goal_R[i, k] * hand.wanted.aim[k]
            hand.stroke_from[i], hand.stroke_to[i] = teleop.x[i], aim
            far += (aim - teleop.x[i]) * (aim - teleop.x[i])
        far = math.sqrt(far)
        if far < hand.near_m:
            return  # So near, the hand goes where the skill says, as it does in contact.
        bits = math.log(1.0 + far / hand.near_m) / math.log(2.0)
        # A minimum-jerk stroke is at most 15 / 8 of its mean speed.
        hand.stroke_T = max(hand.stroke_s + hand.stroke_s_bit * bits, 1.875 * far / hand.skill.speed_m_s)
        # A person who may miss falls short on purpose: too far would be a blow.
        share = max(1.0 - 2.5 * hand.stroke_miss, 0.3)
        for i in range(3):
            way = hand.stroke_to[i] - hand.stroke_from[i]
            hand.stroke_to[i] = hand.stroke_from[i] + share * way + hand.stroke_miss * far * white[27 + i]
            hand.stroke_aside[i] = way / far
        along = 0.0
        for i in range(3):
            along += hand.bow_way[i] * hand.stroke_aside[i]
        for i in range(3):
            hand.stroke_aside[i] = hand.bow * share * far * (hand.bow_way[i] - along * hand.stroke_aside[i])
        hand.is_stroke, hand.stroke_t = 1, 0.0
        hand.strokes += 1
    hand.stroke_t += period_s
    s = min(hand.stroke_t / hand.stroke_T, 1.0)
    done = s * s * s * (10.0 - 15.0 * s + 6.0 * s * s)
    aside = math.sin(math.pi * done) ** 2
    for i in range(3):
        way = hand.stroke_to[i] - hand.stroke_from[i]
        hand.x[i] = hand.stroke_from[i] + done * way + aside * hand.stroke_aside[i]
    if s >= 1.0:
        hand.is_stroke, hand.stroke_t = 0, 0.0


@kernel
def _stay(hand, teleop):
    for i in range(3):
        hand.x[i] = teleop.x[i]


@kernel
def _deflect(hand, teleop, period_s, white):
    """From what is off to counts: the lag of the hand, leaks between axes, noise, tremor, and whole numbers."""
    multiply_transposed_into(hand.R, teleop.R, hand.matrix)
    log_into(hand.matrix, hand.vector)
    dead, lag = teleop.deadzone, 1.0 - math.exp(-period_s / hand.hand_s)
    keep = math.exp(-period_s / hand.motor_noise_s)
    fresh = math.sqrt(1.0 - keep * keep)
    turn = 2.0 * math.pi * hand.tremor_hz * period_s
    ring = 0.97  # Narrow, but not a pure tone.
    cos, sin = ring * math.cos(turn), ring * math.sin(turn)
    shake = hand.tremor * math.sqrt(1.0 - ring * ring)
    for a in range(6):
        off = hand.x[a] - teleop.x[a] if a < 3 else hand.vector[a - 3]
        meant = min(max(off / (hand.grip_s * teleop.speed[a]), -1.0), 1.0)
        hand.deflection[a] += lag * (meant - hand.deflection[a])
        hand.noise[a] = keep * hand.noise[a] + fresh * white[a]
        u, v = hand.tremble[a, 0], hand.tremble[a, 1]
        hand.tremble[a, 0] = cos * u - sin * v + shake * white[6 + 2 * a]
        hand.tremble[a, 1] = sin * u + cos * v + shake * white[7 + 2 * a]
    for a in range(6):
        made = hand.deflection[a]
        for b in range(6):
            made += hand.crosstalk[a, b] * hand.deflection[b]
        made *= 1.0 + hand.motor_noise * hand.noise[a]
        # A person knows the deadzone, and crosses it at once; what is very little is lost in it.
        hand.physical[a] = (1.0 - dead) * made + dead * math.tanh(made / 0.005) + hand.tremble[a, 0]
    for a in range(6):
        share = min(max(teleop.sign[a] * hand.physical[a], -1.0), 1.0)
        hand.counts[teleop.axis[a]] = np.int64(np.rint(share * teleop.full_scale))
