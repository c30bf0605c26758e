"""What is let in: numbers that are finite, and requests that can be meant. Also how a safeguard says that it acted."""

import math

from wrenchflow.compiled import kernel

FURTHEST_M = 10.0  # No arm reaches further.
MOST_RAD = 7.0  # No segment turns further: a whole turn and a bit.
FURTHEST_RAD = 100.0  # Nor has a joint that turns further.
FASTEST_RAD_S = 1e3  # No joint turns faster.
MOST_INERTIA = 1e3  # In [kg m^2]; an arm's largest is about 3.
JUMP_RAD = 0.1  # In a tick: forty times as far as the fastest joint of an arm gets.
MOST_N = 1e4  # No feed-forward is meant to be more, in [N] or [N.m]; the caps are far below.


@kernel
def is_on(ctl, safeguard):
    """Whether a safeguard is in force; one is left out only to see what it is worth, in simulation."""
    return (ctl.without >> safeguard) & 1 == 0


@kernel
def note(ctl, safeguard):
    """Remember that a safeguard intervened at this tick."""
    ctl.acting |= 1 << safeguard


@kernel
def fill(values, value):
    """Set every value of an array; a slice would do the same, and take a second to compile for each kind of array."""
    for i in range(values.size):
        values.flat[i] = value


@kernel
def copy_into(values, out):
    """Copy one (3, 3) matrix into another."""
    for i in range(3):
        for j in range(3):
            out[i, j] = values[i, j]


@kernel
def all_finite(values):
    """Whether every value is finite; min and max let NaN pass, so it is asked outright."""
    for value in values.flat:  # noqa: SIM110 (numba compiles the loop, not the generator)
        if not math.isfinite(value):
            return False
    return True


@kernel
def all_within(values, bound):
    """Whether every value is from -bound to bound; NaN is not."""
    for value in values.flat:  # noqa: SIM110 (numba compiles the loop, not the generator)
        if not abs(value) <= bound:
            return False
    return True


@kernel
def state_is_sound(obs):
    """Whether everything that the law reads of the robot's state is finite, and as an arm can be."""
    for j in range(obs.q.size):
        if not obs.M[j, j] > 0.0:
            return False
    return (
        all_within(obs.q, FURTHEST_RAD)
        and all_within(obs.dq, FASTEST_RAD_S)
        and all_within(obs.x, FURTHEST_M)
        and is_rotation(obs.R, 1e-3)
        and all_within(obs.J, FURTHEST_M)
        and all_within(obs.M, MOST_INERTIA)
        and all_within(obs.coriolis, MOST_N)
    )


@kernel
def has_jumped(obs, ctl):
    """Whether a joint is where it cannot have come to since the last tick: its reading is wrong, now or then."""
    for j in range(obs.q.size):  # noqa: SIM110 (numba compiles the loop, not the generator)
        if not abs(obs.q[j] - ctl.q_last[j]) <= JUMP_RAD:
            return True
    return False


@kernel
def request_is_sound(req):
    """Whether a request can be meant: places in reach of any arm, a rotation, and a spring that pulls back.

    How far, how fast, how stiff and how damped is for the limits, not for this gate; it keeps out what arithmetic
    cannot bear.
    """
    if not (all_within(req.x_start, FURTHEST_M) and all_within(req.x_stop, FURTHEST_M)):
        return False
    if not (all_within(req.x_offset, FURTHEST_M) and all_within(req.turn, MOST_RAD)):
        return False
    if not (all_finite(req.K_lin) and all_finite(req.K_rot) and math.isfinite(req.damping_ratio)):
        return False
    if not (all_within(req.wrench, MOST_N) and is_rotation(req.R_start, 1e-6)):
        return False
    return req.damping_ratio >= 0.0 and is_stiffness(req.K_lin) and is_stiffness(req.K_rot)


@kernel
def is_rotation(R, tolerance):
    """Whether a matrix is a rotation; a mirror is orthonormal too, and is none, and neither is what is not finite."""
    if not (all_within(R, 2.0) and _determinant(R) > 0.0):
        return False
    for i in range(3):
        for j in range(3):
            dot = R[i, 0] * R[j, 0] + R[i, 1] * R[j, 1] + R[i, 2] * R[j, 2]
            if not abs(dot - (1.0 if i == j else 0.0)) <= tolerance:
                return False
    return True


@kernel
def is_stiffness(K):
    """Whether a matrix is one that a spring can have: symmetric, and pulling back in no direction less than not at all.

    A sum of springs has no negative principal minor; one that had would push the arm away from its target.
    """
    scale = abs(K[0, 0]) + abs(K[1, 1]) + abs(K[2, 2])
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        if K[i, i] < 0.0 or abs(K[i, j] - K[j, i]) > 1e-9 * scale:
            return False
        if K[j, j] * K[k, k] - K[j, k] * K[k, j] < -1e-9 * scale * scale:
            return False
    return _determinant(K) >= -1e-9 * scale * scale * scale


@kernel
def _determinant(A):
    return (
        A[0, 0] * (A[1, 1] * A[2, 2] - A[1, 2] * A[2, 1])
        - A[0, 1] * (A[1, 0] * A[2, 2] - A[1, 2] * A[2, 0])
        + A[0, 2] * (A[1, 0] * A[2, 1] - A[1, 1] * A[2, 0])
    )
