"""The plan that is followed: a buffer of stamped waypoints, what newly comes in, and the target at any time.

Packets go through the gate of `control.packet`; a waypoint that has passed, or comes too soon to be met, is dropped.
From its first kept stamp on a packet replaces what was planned, and what was planned before that stays: one plan gives
the same target, bit for bit, in one packet or in eight. Where the way changes under the target, it goes on as it was
going, and the difference decays within `blend_ns`: target and velocity are continuous at every receipt.

Spline time is the loop's time plus the actuation latency, so that the arm, not the command, meets the stamps.
"""

import math

import numpy as np

from wrenchflow.compiled import kernel
from wrenchflow.control.blend import NEVER_NS, add_blend, begin_blend, remember
from wrenchflow.control.packet import ACCEPTED, LATE, MOST_WAYPOINTS, REASONS, TOO_MANY, reason_against
from wrenchflow.control.records import record_dtype
from wrenchflow.control.safeguards import RUN
from wrenchflow.control.spline import fit, locate, place
from wrenchflow.so3 import matrix_into

MOST_KNOTS = 2 * MOST_WAYPOINTS  # What a packet brings, and what stays before it.

SCHEDULE = record_dtype(
    [
        # What is followed: knots of the spline, the ones that have passed and are still needed first.
        ("count", "i8"),
        ("t", "i8", MOST_KNOTS),  # spline time [ns]
        ("x", "f8", (MOST_KNOTS, 3)),  # [m]
        ("R", "f8", (MOST_KNOTS, 3, 3)),
        ("K_lin", "f8", (MOST_KNOTS, 3, 3)),  # [N/m]
        ("K_rot", "f8", (MOST_KNOTS, 3, 3)),  # [N.m/rad]
        ("damping_ratio", "f8", MOST_KNOTS),
        ("wrench", "f8", (MOST_KNOTS, 6)),  # [N, N.m]
        ("gripper", "f8", MOST_KNOTS),  # [m]; NaN where none is asked
        ("velocity", "f8", (MOST_KNOTS, 3)),  # at a knot [m/s]
        ("spin", "f8", (MOST_KNOTS, 3)),  # angular velocity at a knot [rad/s]
        ("turn", "f8", (MOST_KNOTS, 3)),  # from a knot to the next [rad]
        ("spin_stop", "f8", (MOST_KNOTS, 3)),  # rate of that rotation vector where it ends [rad/s]
        # What decays besides: position, its rate, rotation, its rate, as they were at `blend_from_ns`.
        ("blend", "f8", (4, 3)),
        ("blend_from_ns", "i8"),
        # The newest accepted plan.
        ("t_obs_ns", "i8"),
        ("accepted_ns", "i8"),
        ("period_ns", "i8"),
        ("end_ns", "i8"),  # when the target comes to stand at the last waypoint, in the loop's time
        ("seam_jump_m", "f8"),  # how far the target would have jumped at its receipt, were it not for the blend
        ("seam_jump_rad", "f8"),
        # Counts since the start.
        ("counts", "i8", len(REASONS)),  # packets by what became of them
        ("dropped", "i8"),  # waypoints that had passed, or came too soon
        # What was followed before the present tick's packets: the spline now and a tick later, and what decayed.
        ("was_followed", "i8"),
        ("old_x", "f8", (2, 3)),
        ("old_R", "f8", (2, 3, 3)),
        ("old_blend", "f8", (4, 3)),
        ("old_blend_from_ns", "i8"),
        # Constants; `make_schedule` sets them once.
        ("lead_ns", "i8"),  # a waypoint that is nearer than this comes too soon
        ("blend_ns", "i8"),
        ("actuation_latency_ns", "i8"),  # from a command until the arm does it
        ("oldest_ns", "i8"),  # of the observation that a plan was made from
        ("workspace_min", "f8", 3),  # [m]
        ("workspace_max", "f8", 3),
        # What a call works with, kept here so that the loop allocates nothing.
        ("new_x", "f8", (2, 3)),
        ("new_R", "f8", (2, 3, 3)),
        ("gap", "f8", (2, 3)),
        ("matrices", "f8", (3, 3, 3)),
        ("vectors", "f8", (2, 4)),
    ]
)


def make_schedule(
    workspace_min_m: tuple[float, float, float],
    workspace_max_m: tuple[float, float, float],
    *,
    lead_s: float = 0.005,
    blend_s: float = 0.1,
    actuation_latency_s: float = 0.0,
    oldest_s: float = 1.0,
) -> np.ndarray:
    """A schedule that follows nothing yet.

    Args:
        workspace_min_m: Where poses may be, in the base frame [m].
        workspace_max_m: The opposite corner.
        lead_s: A waypoint that is nearer than this when its plan arrives is dropped [s].
        blend_s: In which a difference between plans decays [s].
        actuation_latency_s: From a command until the arm does it [s]; plans are followed ahead by it.
        oldest_s: Of an observation that a plan may be made from, at the plan's receipt [s].

    Returns:
        One record, dtype `SCHEDULE`. Shape (1,).
    """
    schedule = np.zeros(1, SCHEDULE)
    state = schedule[0]
    state["workspace_min"], state["workspace_max"] = workspace_min_m, workspace_max_m
    state["lead_ns"], state["blend_ns"] = round(lead_s * 1e9), round(blend_s * 1e9)
    state["actuation_latency_ns"], state["oldest_ns"] = round(actuation_latency_s * 1e9), round(oldest_s * 1e9)
    clear(state)
    return schedule


@kernel
def clear(schedule):
    """Follow nothing, and forget all plans and counts; the constants stay."""
    schedule.count, schedule.dropped, schedule.was_followed = 0, 0, 0
    schedule.blend_from_ns, schedule.old_blend_from_ns = NEVER_NS, NEVER_NS
    schedule.t_obs_ns, schedule.accepted_ns, schedule.end_ns = NEVER_NS, NEVER_NS, NEVER_NS
    schedule.period_ns = 0
    schedule.seam_jump_m, schedule.seam_jump_rad = 0.0, 0.0
    for i in range(schedule.counts.shape[0]):
        schedule.counts[i] = 0


@kernel
def accept(packet, schedule, ctl, now_ns):
    """Take in a packet that is there at `now_ns`, before the tick of that stamp or after it.

    An accepted one is followed from the next tick on (`ctl.follows_plan`); one that is refused changes nothing but the
    counts. Where nothing is followed, the way begins at the target of the last tick, which stands still.

    Returns:
        What became of it, a number of `packet.REASONS`.
    """
    first, staying, reason = 0, 0, reason_against(packet, schedule, ctl, now_ns)
    clock_ns = now_ns + schedule.actuation_latency_ns
    # Packets of one tick are parts of one: the seam is where the target left what it followed before them.
    is_next_part = ctl.follows_plan != 0 and schedule.count > 0 and schedule.accepted_ns == now_ns
    was_followed = ctl.follows_plan != 0 and schedule.count > 0 and ctl.mode == RUN and schedule.t[0] <= clock_ns
    goes_on = is_next_part or (was_followed and now_ns < schedule.end_ns)
    if reason == ACCEPTED:
        while first < packet.count and packet.t[first] <= clock_ns + schedule.lead_ns:
            first += 1
        schedule.dropped += first
        if first == packet.count:
            reason = LATE
        else:
            passed = _passed(schedule, clock_ns) if goes_on else 0
            staying = _staying(schedule, packet.t[first]) if goes_on else 1
            if staying - passed + packet.count - first > MOST_KNOTS:
                reason = TOO_MANY
    schedule.counts[reason] += 1
    if reason != ACCEPTED:
        return reason
    if not is_next_part:
        remember(schedule, was_followed, now_ns)
    if goes_on:
        schedule.count = staying
        _discard(schedule, passed)
    else:
        _begin(schedule, ctl, clock_ns)
    for i in range(first, packet.count):
        _append(schedule, packet, i)
    fit(schedule, schedule.matrices[0], schedule.vectors[0])
    begin_blend(schedule, now_ns)
    schedule.t_obs_ns, schedule.period_ns, schedule.accepted_ns = packet.t_obs_ns, packet.period_ns, now_ns
    schedule.end_ns = schedule.t[schedule.count - 1] - schedule.actuation_latency_ns
    ctl.follows_plan = 1
    return reason


@kernel
def evaluate(schedule, t_ns, ctl):
    """Put what is asked for at a time into the targets of `ctl`; after the last waypoint, that it stays there.

    Stiffness, damping ratio, feed-forward and the gripper's width go in straight lines from knot to knot; a width that
    one end does not ask for changes at the knot.
    """
    if schedule.count == 0:
        return
    i, share = locate(schedule, t_ns + schedule.actuation_latency_ns)
    place(schedule, i, share, schedule.matrices[0], ctl.x_target, ctl.R_target)
    add_blend(schedule, schedule.blend, schedule.blend_from_ns, t_ns, ctl.x_target, ctl.R_target)
    j = min(i + 1, schedule.count - 1)
    for k in range(3):
        for m in range(3):
            ctl.K_lin_target[k, m] = _between(schedule.K_lin[i, k, m], schedule.K_lin[j, k, m], share)
            ctl.K_rot_target[k, m] = _between(schedule.K_rot[i, k, m], schedule.K_rot[j, k, m], share)
    for k in range(6):
        ctl.wrench_target[k] = _between(schedule.wrench[i, k], schedule.wrench[j, k], share)
    ctl.damping_ratio_target = _between(schedule.damping_ratio[i], schedule.damping_ratio[j], share)
    ctl.gripper_target = schedule.gripper[i]
    if math.isfinite(schedule.gripper[i]) and math.isfinite(schedule.gripper[j]):
        ctl.gripper_target = _between(schedule.gripper[i], schedule.gripper[j], share)


@kernel
def _between(start, stop, share):
    return start + share * (stop - start)


@kernel
def _passed(schedule, clock_ns):
    # How many knots nothing needs any more: the segment needs its start, and the tangent there the knot before it.
    i, _ = locate(schedule, clock_ns)
    return max(i - 1, 0)


@kernel
def _staying(schedule, t_ns):
    count = 0
    while count < schedule.count and schedule.t[count] < t_ns:
        count += 1
    return count


@kernel
def _discard(knots, passed):
    for j in range(knots.count - passed):
        i = j + passed
        knots.t[j], knots.gripper[j], knots.damping_ratio[j] = knots.t[i], knots.gripper[i], knots.damping_ratio[i]
        for k in range(6):
            knots.wrench[j, k] = knots.wrench[i, k]
        for k in range(3):
            knots.x[j, k] = knots.x[i, k]
            for m in range(3):
                knots.R[j, k, m] = knots.R[i, k, m]
                knots.K_lin[j, k, m], knots.K_rot[j, k, m] = knots.K_lin[i, k, m], knots.K_rot[i, k, m]
    knots.count -= passed


@kernel
def _begin(knots, ctl, clock_ns):
    knots.count, knots.t[0] = 1, clock_ns
    knots.gripper[0], knots.damping_ratio[0] = ctl.gripper_target, ctl.damping_ratio_target
    for k in range(6):
        knots.wrench[0, k] = ctl.wrench_target[k]
    for k in range(3):
        knots.x[0, k] = ctl.x_target[k]
        for m in range(3):
            knots.R[0, k, m] = ctl.R_target[k, m]
            knots.K_lin[0, k, m], knots.K_rot[0, k, m] = ctl.K_lin_target[k, m], ctl.K_rot_target[k, m]


@kernel
def _append(knots, packet, i):
    j, quat = knots.count, packet.quat_wxyz[i]
    knots.count, knots.t[j] = j + 1, packet.t[i]
    knots.gripper[j], knots.damping_ratio[j] = packet.gripper[i], packet.damping_ratio[i]
    for k in range(6):
        knots.wrench[j, k] = packet.wrench[i, k]
    for k in range(3):
        knots.x[j, k] = packet.x[i, k]
        for m in range(3):
            knots.K_lin[j, k, m], knots.K_rot[j, k, m] = packet.K_lin[i, k, m], packet.K_rot[i, k, m]
    # The matrix is the same for both quaternions of a rotation, and orthonormal whatever the quaternion's length.
    matrix_into(quat[0], quat[1], quat[2], quat[3], knots.R[j])
