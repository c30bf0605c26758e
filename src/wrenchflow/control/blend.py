"""What keeps the target steady where a new plan bends its way: the difference to the old way, which decays.

At a plan's receipt, now and a tick later, the target on the old way is compared with the one on the new way. The
difference, as position and rotation vector with their rates, is added to the new way and goes to zero and to rest by a
cubic within `blend_ns`. What was still decaying of an earlier plan is part of the old way.
"""

import math

from wrenchflow.compiled import kernel
from wrenchflow.control.spline import NS, locate, place
from wrenchflow.so3 import exp_into, log_into, multiply_into, multiply_transposed_into

TICK_NS = 1_000_000
NEVER_NS = -(2**62)


@kernel
def remember(schedule, was_followed, now_ns):
    """Keep, before a tick's first packet is taken in, where the target was going."""
    schedule.was_followed = 1 if was_followed else 0
    if was_followed:
        schedule.old_blend_from_ns = schedule.blend_from_ns
        _copy(schedule.blend, schedule.old_blend)
        _look_ahead(schedule, now_ns, schedule.old_x, schedule.old_R)


@kernel
def begin_blend(schedule, now_ns):
    """Let the target go on from where it was going; what decays goes on untouched where the way is the same."""
    x, R, old_x, old_R = schedule.new_x, schedule.new_R, schedule.old_x, schedule.old_R
    schedule.seam_jump_m, schedule.seam_jump_rad = 0.0, 0.0
    schedule.blend_from_ns = NEVER_NS
    if schedule.was_followed == 0:
        return
    _look_ahead(schedule, now_ns, x, R)
    is_same = True
    for j in range(2):
        for k in range(3):
            is_same = is_same and x[j, k] == old_x[j, k]
            for m in range(3):
                is_same = is_same and R[j, k, m] == old_R[j, k, m]
    if is_same:
        schedule.blend_from_ns = schedule.old_blend_from_ns
        _copy(schedule.old_blend, schedule.blend)
        return
    # The old way itself stays as it is, for the next packet of this tick to be compared with.
    gap, R_gap, turn = schedule.gap, schedule.matrices[2], schedule.vectors
    _copy(old_x, gap)
    for j in range(2):
        _copy(old_R[j], R_gap)
        add_blend(schedule, schedule.old_blend, schedule.old_blend_from_ns, now_ns + j * TICK_NS, gap[j], R_gap)
        for k in range(3):
            gap[j, k] -= x[j, k]
        multiply_transposed_into(R_gap, R[j], schedule.matrices[0])
        log_into(schedule.matrices[0], turn[j])
    _unwrap(turn[0], turn[1])
    squared_m, squared_rad = 0.0, 0.0
    for k in range(3):
        schedule.blend[0, k], schedule.blend[1, k] = gap[0, k], (gap[1, k] - gap[0, k]) / (TICK_NS * NS)
        schedule.blend[2, k], schedule.blend[3, k] = turn[0, k], (turn[1, k] - turn[0, k]) / (TICK_NS * NS)
        squared_m += gap[0, k] * gap[0, k]
        squared_rad += turn[0, k] * turn[0, k]
    schedule.blend_from_ns = now_ns
    schedule.seam_jump_m, schedule.seam_jump_rad = math.sqrt(squared_m), math.sqrt(squared_rad)


@kernel
def add_blend(schedule, blend, from_ns, t_ns, x, R):
    """Add to a pose, `x` (3,) and `R` (3, 3), what is left at `t_ns` of a difference that decays since `from_ns`."""
    if t_ns - from_ns >= schedule.blend_ns:
        return
    s = (t_ns - from_ns) / schedule.blend_ns if t_ns > from_ns else 0.0
    value, rate = (1.0 + 2.0 * s) * (1.0 - s) * (1.0 - s), s * (1.0 - s) * (1.0 - s) * (schedule.blend_ns * NS)
    for k in range(3):
        x[k] += value * blend[0, k] + rate * blend[1, k]
    exp_into(
        value * blend[2, 0] + rate * blend[3, 0],
        value * blend[2, 1] + rate * blend[3, 1],
        value * blend[2, 2] + rate * blend[3, 2],
        schedule.matrices[0],
    )
    multiply_into(schedule.matrices[0], R, schedule.matrices[1])
    _copy(schedule.matrices[1], R)


@kernel
def _copy(matrix, out):
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            out[i, j] = matrix[i, j]


@kernel
def _look_ahead(schedule, now_ns, x, R):
    for j in range(2):
        i, share = locate(schedule, now_ns + j * TICK_NS + schedule.actuation_latency_ns)
        place(schedule, i, share, schedule.matrices[0], x[j], R[j])


@kernel
def _unwrap(first, second):
    # Near half a turn the logarithm changes sides; the rate must not see that.
    if first[0] * second[0] + first[1] * second[1] + first[2] * second[2] < 0.0:
        angle = math.sqrt(second[0] * second[0] + second[1] * second[1] + second[2] * second[2])
        if angle > 0.5 * math.pi:
            for k in range(3):
                second[k] *= 1.0 - 2.0 * math.pi / angle
