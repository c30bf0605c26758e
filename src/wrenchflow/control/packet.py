"""What a policy sends, as plain memory, and the gate that looks at it before anything is followed.

Nobody is trusted: whatever bytes come, a packet is either sound, or refused with a reason that has a name. Kernels read
the constants of this file, so it is one of those that `wrenchflow.compiled` looks at for changes.
"""

import math

from wrenchflow.compiled import kernel
from wrenchflow.control.gate import all_within, is_stiffness
from wrenchflow.control.records import record_dtype
from wrenchflow.control.safeguards import LATCHED, SOFT_STOP

MOST_WAYPOINTS = 64
HORIZON_NS = 10_000_000_000  # No plan reaches further ahead.
PERIOD_NS = 2_000_000_000  # Nor is the next one promised for later: a plan tells by it how long silence is borne.
WIDEST_M = 1.0  # No gripper opens further.
MOST = 1e12  # Nothing that is meant is larger, in any unit; below it no sum and no product here overflows.
UNIT_TOLERANCE = 1e-3  # of a quaternion's length; what is within is normalised.

# A plan: where to be at which time, and how stiffly. Poses are of the TCP, everything is in the axes of the base frame.
PACKET = record_dtype(
    [
        ("seq", "i8"),
        ("model", "i8"),  # who made it
        ("t_obs_ns", "i8"),  # stamp of the observation that it was made from
        ("period_ns", "i8"),  # until its maker's next plan is to be expected
        ("count", "i8"),  # waypoints; only so many of what follows are looked at
        ("t", "i8", MOST_WAYPOINTS),  # when to be there [ns]
        ("x", "f8", (MOST_WAYPOINTS, 3)),  # [m]
        ("quat_wxyz", "f8", (MOST_WAYPOINTS, 4)),
        ("K_lin", "f8", (MOST_WAYPOINTS, 3, 3)),  # [N/m]
        ("K_rot", "f8", (MOST_WAYPOINTS, 3, 3)),  # [N.m/rad]
        ("damping_ratio", "f8", MOST_WAYPOINTS),
        ("wrench", "f8", (MOST_WAYPOINTS, 6)),  # feed-forward, about the TCP [N, N.m]
        ("gripper", "f8", MOST_WAYPOINTS),  # width [m]; NaN where none is asked
    ]
)

# What becomes of a packet, each with what it means; a reason's number is its place here.
REASONS = {
    "accepted": "it is followed",
    "empty": "it has no waypoint",
    "too-many": "it has more waypoints than there is room for",
    "not-finite": "a value is not finite, or larger than any that is meant",
    "period": "the time until the next plan is not above 0, or longer than 2 s",
    "stamps": "its stamps do not increase",
    "horizon": "a stamp lies too far ahead",
    "quaternion": "a quaternion is not of unit length",
    "workspace": "a pose lies outside the workspace",
    "stiffness": "a stiffness is not symmetric, or would push the arm away",
    "damping-ratio": "a damping ratio is negative",
    "replayed": "it was made from the observation of the plan that is followed",
    "reordered": "one that was made later is followed already",
    "future": "it was made from an observation that is still to come",
    "past": "it was made from an observation that is too old",
    "retreat": "it was made before the arm had retreated, or had begun",
    "late": "all its waypoints have passed",
    "gripper": "a width is negative, or wider than any gripper",
    "stopped": "the arm is stopping, or latched",
}
(
    ACCEPTED,
    EMPTY,
    TOO_MANY,
    NOT_FINITE,
    PERIOD,
    STAMPS,
    TOO_FAR,
    QUATERNION,
    OUTSIDE,
    STIFFNESS,
    DAMPING,
    REPLAYED,
    REORDERED,
    FUTURE,
    PAST,
    RETREATED,
    LATE,
    GRIPPER,
    STOPPED,
) = range(len(REASONS))


@kernel
def reason_against(packet, schedule, ctl, now_ns):
    """Look at a packet that is there at `now_ns`; `ACCEPTED` if nothing speaks against it."""
    if ctl.mode == SOFT_STOP or ctl.mode == LATCHED or ctl.is_stop_asked:
        return STOPPED
    if packet.count < 1:
        return EMPTY
    if packet.count > MOST_WAYPOINTS:
        return TOO_MANY
    if not 0 < packet.period_ns <= PERIOD_NS:
        return PERIOD
    if packet.t_obs_ns > now_ns:
        return FUTURE
    if packet.t_obs_ns == schedule.t_obs_ns:
        return REPLAYED
    if packet.t_obs_ns < schedule.t_obs_ns:
        return REORDERED
    if packet.t_obs_ns < now_ns - schedule.oldest_ns:
        return PAST
    if packet.t_obs_ns < ctl.retreat_ns:
        return RETREATED
    for i in range(packet.count):
        if i > 0 and packet.t[i] <= packet.t[i - 1]:
            return STAMPS
        reason = _reason_against_waypoint(packet, i, schedule)
        if reason != ACCEPTED:
            return reason
    # Stamps are only ever compared, or subtracted once they are known to be near: a wild one would wrap around.
    return TOO_FAR if packet.t[packet.count - 1] > now_ns + HORIZON_NS else ACCEPTED


@kernel
def _reason_against_waypoint(packet, i, schedule):
    if not (
        all_within(packet.x[i], MOST)
        and all_within(packet.quat_wxyz[i], MOST)
        and all_within(packet.K_lin[i], MOST)
        and all_within(packet.K_rot[i], MOST)
        and all_within(packet.wrench[i], MOST)
        and abs(packet.damping_ratio[i]) <= MOST
        and (math.isnan(packet.gripper[i]) or abs(packet.gripper[i]) <= MOST)
    ):
        return NOT_FINITE
    squared = 0.0
    for k in range(4):
        squared += packet.quat_wxyz[i, k] * packet.quat_wxyz[i, k]
    if not abs(math.sqrt(squared) - 1.0) <= UNIT_TOLERANCE:
        return QUATERNION
    for k in range(3):
        if not schedule.workspace_min[k] <= packet.x[i, k] <= schedule.workspace_max[k]:
            return OUTSIDE
    if not (is_stiffness(packet.K_lin[i]) and is_stiffness(packet.K_rot[i])):
        return STIFFNESS
    if packet.damping_ratio[i] < 0.0:
        return DAMPING
    return ACCEPTED if math.isnan(packet.gripper[i]) or 0.0 <= packet.gripper[i] <= WIDEST_M else GRIPPER
