"""From what a device says to what the control core is asked for: axis map, deadzone, dead man, target. One way for all.

A device moves the target, never the measured pose: with "pose + increment" at every period there would be no spring,
and no force could be held.
"""

import math

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow import signals
from wrenchflow.collect.devices.device import Reading
from wrenchflow.collect.devices.twist_map import TwistMap
from wrenchflow.compiled import kernel
from wrenchflow.control.config import Impedance
from wrenchflow.control.controller import TICK_S, Controller, patience_ticks
from wrenchflow.control.records import record_dtype
from wrenchflow.so3 import exp_into, log_into, multiply_into, multiply_transposed_into
from wrenchflow.spatial import make_pose, rotation_of

# Why the arm stays where it is. What a device itself says is wrong comes in words, with its reading.
PROBLEMS = ("", "the device is silent", "the clock jumped", "the device is not sound")
_NONE, _SILENT, _LEAPED, _UNSOUND = np.int64(0), np.int64(1), np.int64(2), np.int64(3)
_LEAP_NS = 1_000_000_000  # A period is milliseconds; a clock that goes on by a second, or back, is none.

TELEOP = record_dtype(
    [
        # What the device said last.
        ("counts", "i8", 6),
        ("buttons", "i8", 1),
        ("report_ns", "i8"),
        ("is_pose", "i8"),  # it said where the TCP should be, not how fast
        ("x_pose", "f8", 3),
        ("R_pose", "f8", (3, 3)),
        ("is_sound", "i8"),
        # What came of it.
        ("now_ns", "i8"),
        ("problem", "i8"),  # of PROBLEMS
        ("twist", "f8", 6),  # of the target, base axes [m/s, rad/s]
        ("x", "f8", 3),  # the target
        ("R", "f8", (3, 3)),
        ("x_offset", "f8", 3),  # a disturbance, tracked besides the target [m]
        # How, set once.
        ("axis", "i8", 6),  # of the device that moves axis i of the twist
        ("sign", "f8", 6),
        ("full_scale", "f8"),
        ("deadzone", "f8"),
        ("speed", "f8", 6),  # at full scale
        ("dead_man_ns", "i8"),
        ("leap_ns", "i8"),
        ("period_s", "f8"),
        ("ticks", "i8"),
        ("patience_ticks", "i8"),
        ("K_lin", "f8"),
        ("K_rot", "f8"),
        ("damping_ratio", "f8"),
        ("matrices", "f8", (2, 3, 3)),  # what a period works with
        ("vector", "f8", 4),
    ]
)

# What a recording keeps of a period: what the device said, what became of it, and what the operator thought to do.
PERIOD = np.dtype(
    [
        ("t_ns", "i8"),
        ("teleop/joy", "f8", signals.JOY.width),
        ("teleop/twist", "f8", signals.TWIST.width),
        ("phase", "i8"),  # of the task's phases, or -1
        ("problem", "i8"),  # of PROBLEMS
    ],
    align=True,
)


@kernel
def note(teleop, phase, row):
    """Store a period in a `PERIOD` record."""
    row.t_ns, row.phase, row.problem = teleop.now_ns, phase, teleop.problem
    joy, twist = row["teleop/joy"], row["teleop/twist"]
    for a in range(6):
        joy[a], twist[a] = teleop.counts[a], teleop.twist[a]
    joy[6] = teleop.buttons[0] & 1
    joy[7] = (teleop.buttons[0] >> 1) & 1


@kernel
def follow(teleop, now_ns, req, ctl):
    """One period: judge what was said, move the target by it, and ask for the way there; records, not arrays of them.

    Args:
        teleop: A `TELEOP` record, what the device said in it.
        now_ns: The time now, on the clock that `report_ns` is of.
        req: A `REQ` record, overwritten.
        ctl: A `CTL` record, which is told that something was asked.
    """
    teleop.problem = _judge(teleop, now_ns)
    teleop.now_ns = now_ns
    if teleop.problem != _NONE:
        for a in range(6):
            teleop.twist[a] = 0.0
    elif teleop.is_pose:
        _twist_towards(teleop)
    else:
        for a in range(6):
            count = teleop.counts[teleop.axis[a]]
            teleop.twist[a] = teleop.sign[a] * teleop.speed[a] * past_deadzone(teleop, count)
    step, turned = teleop.matrices[0], teleop.matrices[1]
    for i in range(3):
        turn = teleop.twist[3 + i] * teleop.period_s
        req.x_start[i], req.turn[i], req.x_offset[i] = teleop.x[i], turn, teleop.x_offset[i]
        teleop.x[i] += teleop.twist[i] * teleop.period_s
        req.x_stop[i] = teleop.x[i]
        for j in range(3):
            req.R_start[i, j] = teleop.R[i, j]
            same = 1.0 if i == j else 0.0
            req.K_lin[i, j], req.K_rot[i, j] = same * teleop.K_lin, same * teleop.K_rot
    exp_into(req.turn[0], req.turn[1], req.turn[2], step)
    multiply_into(step, teleop.R, turned)
    for i in range(3):
        for j in range(3):
            teleop.R[i, j] = turned[i, j]
    for a in range(6):
        req.wrench[a] = 0.0
    req.damping_ratio, req.ticks, req.patience_ticks = teleop.damping_ratio, teleop.ticks, teleop.patience_ticks
    ctl.is_asked = 1


@kernel
def _judge(teleop, now_ns):
    if not teleop.is_sound:
        return _UNSOUND
    if teleop.now_ns != 0 and (now_ns <= teleop.now_ns or now_ns - teleop.now_ns > teleop.leap_ns):
        return _LEAPED
    is_moving = teleop.is_pose != 0
    for a in range(6):
        is_moving = is_moving or teleop.counts[a] != 0
    age_ns = now_ns - teleop.report_ns
    return _SILENT if is_moving and (age_ns > teleop.dead_man_ns or age_ns < 0) else _NONE


@kernel
def past_deadzone(teleop, count):
    """Share of the full speed, -1 to 1, that a count of one axis stands for; past the deadzone it grows from zero."""
    share = min(max(count / teleop.full_scale, -1.0), 1.0)
    past = max(abs(share) - teleop.deadzone, 0.0) / (1.0 - teleop.deadzone)
    return -past if share < 0.0 else past


@kernel
def _twist_towards(teleop):
    """The twist that brings the target to the device's pose in a period, no faster than at full scale."""
    turn, out = teleop.matrices[0], teleop.vector
    multiply_transposed_into(teleop.R_pose, teleop.R, turn)
    log_into(turn, out)
    far_m = far_rad = 0.0
    for i in range(3):
        teleop.twist[i] = (teleop.x_pose[i] - teleop.x[i]) / teleop.period_s
        teleop.twist[3 + i] = out[i] / teleop.period_s
        far_m += teleop.twist[i] * teleop.twist[i]
        far_rad += teleop.twist[3 + i] * teleop.twist[3 + i]
    slower_m = min(1.0, teleop.speed[0] / max(math.sqrt(far_m), 1e-12))
    slower_rad = min(1.0, teleop.speed[3] / max(math.sqrt(far_rad), 1e-12))
    for i in range(3):
        teleop.twist[i] *= slower_m
        teleop.twist[3 + i] *= slower_rad


class Follower:
    """What follows a device: its target, and why it stands still if it does.

    Attributes:
        record: The state, one `TELEOP` record. Shape (1,).
    """

    def __init__(
        self,
        twist_map: TwistMap,
        impedance: Impedance,
        target: Float[np.ndarray, " 7"],
        *,
        full_scale_counts: int,
        ticks: int,
    ) -> None:
        """Begin at a target pose.

        Args:
            twist_map: From axes to a twist.
            impedance: How stiffly the target is followed.
            target: Where the target is now, T_base_target. Shape (7,).
            full_scale_counts: What an axis of the device reports at full deflection.
            ticks: How many ticks of the control core a period has.
        """
        self.record = np.zeros(1, TELEOP)
        state = self.record[0]
        state["axis"], state["sign"] = twist_map.axis_numbers, twist_map.axis_signs
        state["full_scale"], state["deadzone"] = full_scale_counts, twist_map.deadzone
        state["speed"] = np.repeat([twist_map.linear_max_m_s, twist_map.angular_max_rad_s], 3)
        state["dead_man_ns"], state["leap_ns"] = round(twist_map.dead_man_s * 1e9), _LEAP_NS
        state["ticks"], state["period_s"] = ticks, ticks * TICK_S
        state["patience_ticks"] = patience_ticks(ticks * TICK_S)
        state["K_lin"], state["K_rot"] = impedance.translation_n_m, impedance.rotation_nm_rad
        state["damping_ratio"] = impedance.damping_ratio
        state["x"], state["R"] = target[:3], rotation_of(target[3:])
        self._said = ""

    def take(self, reading: Reading) -> None:
        """Hear what the device says."""
        state = self.record[0]
        state["counts"], state["buttons"], state["report_ns"] = reading.counts, reading.buttons, reading.t_ns
        self._said = reading.problem
        state["is_pose"] = reading.pose is not None
        if reading.pose is not None:
            is_pose = np.isfinite(reading.pose).all() and abs(np.linalg.norm(reading.pose[3:]) - 1.0) < 1e-6
            self._said = self._said or ("" if is_pose else "its pose is none")
            if is_pose:
                state["x_pose"], state["R_pose"] = reading.pose[:3], rotation_of(reading.pose[3:])
        state["is_sound"] = not self._said

    def move(self, now_ns: int, controller: Controller) -> None:
        """Move the target by a period, and ask the controller for the way there.

        Args:
            now_ns: The time now, on the clock of the device's stamps.
            controller: Whose request is overwritten.
        """
        follow(self.record[0], now_ns, controller.req[0], controller.ctl[0])

    @property
    def problem(self) -> str:
        """Why the target stands still, in words; empty if it does not have to."""
        number = int(self.record[0]["problem"])
        return self._said if number == _UNSOUND and self._said else PROBLEMS[number]

    @property
    def counts(self) -> Int64[np.ndarray, " 6"]:
        """Axes as the device said them."""
        return self.record[0]["counts"]

    @property
    def twist(self) -> Float[np.ndarray, " 6"]:
        """Twist of the target in the last period, base axes [m/s, rad/s]."""
        return self.record[0]["twist"]

    @property
    def target_pose(self) -> Float[np.ndarray, " 7"]:
        """Where the target is, or will be at the end of the period."""
        return make_pose(self.record[0]["x"].copy(), self.record[0]["R"].copy())
