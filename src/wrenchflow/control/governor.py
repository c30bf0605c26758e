"""What stands between any request and the arm: the finite-value gate, workspace, speed limit, leash and torque limits.

The energy tank, the stiffness slew and the mode machine belong here too, and come with the safety layer.
"""

import math

from wrenchflow.compiled import kernel
from wrenchflow.so3 import exp_into, log_into, multiply_into, multiply_transposed_into

FURTHEST_M = 10.0  # No arm reaches further.
MOST_RAD = 7.0  # No segment turns further: a whole turn and a bit.


@kernel
def all_finite(values):
    """Whether every value is finite; min and max let NaN pass, so it is asked outright."""
    for value in values.flat:  # noqa: SIM110 (numba compiles the loop, not the generator)
        if not math.isfinite(value):
            return False
    return True


@kernel
def state_is_finite(obs):
    """Whether everything that the law reads of the robot's state is finite."""
    return (
        all_finite(obs.q)
        and all_finite(obs.dq)
        and all_finite(obs.x)
        and all_finite(obs.R)
        and all_finite(obs.J)
        and all_finite(obs.M)
        and all_finite(obs.coriolis)
    )


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


@kernel
def all_within(values, bound):
    """Whether every value is from -bound to bound; NaN is not."""
    for value in values.flat:  # noqa: SIM110 (numba compiles the loop, not the generator)
        if not abs(value) <= bound:
            return False
    return True


@kernel
def request_is_sound(req):
    """Whether a request can be meant: places in reach of any arm, a rotation, and a spring that pulls back.

    How far, how fast, how stiff and how damped is for the limits, not for this gate; it keeps out what arithmetic
    cannot bear.
    """
    if not (all_within(req.x_start, FURTHEST_M) and all_within(req.x_stop, FURTHEST_M)):
        return False
    if not (all_within(req.x_offset, FURTHEST_M) and all_within(req.turn, MOST_RAD) and all_finite(req.R_start)):
        return False
    if not (all_finite(req.K_lin) and all_finite(req.K_rot) and math.isfinite(req.damping_ratio)):
        return False
    if _determinant(req.R_start) < 0.0:  # A mirror is orthonormal too.
        return False
    for i in range(3):
        for j in range(3):
            dot = req.R_start[i, 0] * req.R_start[j, 0] + req.R_start[i, 1] * req.R_start[j, 1]
            dot += req.R_start[i, 2] * req.R_start[j, 2]
            if abs(dot - (1.0 if i == j else 0.0)) > 1e-6:
                return False
    return req.damping_ratio >= 0.0 and is_stiffness(req.K_lin) and is_stiffness(req.K_rot)


@kernel
def limit_stiffness(K, K_max, out):
    """Scale a stiffness matrix down, if need be, until no row sum is over `K_max`; its axes stay."""
    largest = 0.0
    for i in range(3):
        row = abs(K[i, 0]) + abs(K[i, 1]) + abs(K[i, 2])
        if row > largest:
            largest = row
    scale = K_max / largest if largest > K_max else 1.0
    for i in range(3):
        for j in range(3):
            out[i, j] = scale * K[i, j]


@kernel
def leash_position(ctl, x):
    """Retract the reference to where its spring pulls with `force_max` at most on each axis, then step it on.

    The leash is a box, so that a push along one axis does not take from the others; `cap_norm` bounds the whole force.

    The retraction costs no energy, so nothing limits it. The voluntary step is limited in speed. Both ends of that step
    lie in the leash, so the reference ends in it at every tick.
    """
    distance = 0.0
    wanted = ctl.vector
    for i in range(3):
        row = abs(ctl.K_lin[i, 0]) + abs(ctl.K_lin[i, 1]) + abs(ctl.K_lin[i, 2])
        leash = ctl.force_max / row if row > 0.0 else 0.0
        low, high = x[i] - leash, x[i] + leash
        ctl.x_d[i] = min(max(ctl.x_d[i], low), high)
        target = min(max(ctl.x_target[i] + ctl.x_offset[i], ctl.workspace_min[i]), ctl.workspace_max[i])
        wanted[i] = min(max(target, low), high) - ctl.x_d[i]
        distance += wanted[i] * wanted[i]
    distance = math.sqrt(distance)
    share = ctl.x_step_max / distance if distance > ctl.x_step_max else 1.0
    for i in range(3):
        ctl.x_d[i] += share * wanted[i]


@kernel
def leash_rotation(ctl, R):
    """The same for rotation: within an angle of the measured one, then a limited turn towards the target."""
    stiffest = 0.0
    for i in range(3):
        row = abs(ctl.K_rot[i, 0]) + abs(ctl.K_rot[i, 1]) + abs(ctl.K_rot[i, 2])
        if row > stiffest:
            stiffest = row
    leash = ctl.moment_max / stiffest if stiffest > 0.0 else 0.0
    wanted, work, vector = ctl.matrices[0], ctl.matrices[1:], ctl.vector
    _pull_within(ctl.R_d, R, leash, work, vector)
    for i in range(3):
        for j in range(3):
            wanted[i, j] = ctl.R_target[i, j]
    _pull_within(wanted, R, leash, work, vector)
    _pull_within(wanted, ctl.R_d, ctl.turn_step_max, work, vector)
    _orthonormal_into(wanted, ctl.R_d)


@kernel
def _pull_within(rotation, centre, angle_max, work, vector):
    difference, turned = work[0], work[1]
    multiply_transposed_into(rotation, centre, difference)
    # Mostly it is within already; its cosine tells that without the logarithm.
    cosine = (difference[0, 0] + difference[1, 1] + difference[2, 2] - 1.0) / 2.0
    if angle_max >= math.pi or cosine >= math.cos(angle_max):
        return
    log_into(difference, vector)
    angle = math.sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2])
    if angle <= angle_max:  # Rounding: a cosine of a little less than 1 is of no angle at all.
        return
    share = angle_max / angle
    exp_into(share * vector[0], share * vector[1], share * vector[2], difference)
    multiply_into(difference, centre, turned)
    for i in range(3):
        for j in range(3):
            rotation[i, j] = turned[i, j]


@kernel
def _orthonormal_into(A, out):
    # Products of rotations drift off by an ulp a tick; one Gram-Schmidt a tick keeps the reference a rotation for ever.
    n = math.sqrt(A[0, 0] * A[0, 0] + A[1, 0] * A[1, 0] + A[2, 0] * A[2, 0])
    for i in range(3):
        out[i, 0] = A[i, 0] / n
    dot = out[0, 0] * A[0, 1] + out[1, 0] * A[1, 1] + out[2, 0] * A[2, 1]
    for i in range(3):
        out[i, 1] = A[i, 1] - dot * out[i, 0]
    n = math.sqrt(out[0, 1] * out[0, 1] + out[1, 1] * out[1, 1] + out[2, 1] * out[2, 1])
    for i in range(3):
        out[i, 1] /= n
    out[0, 2] = out[1, 0] * out[2, 1] - out[2, 0] * out[1, 1]
    out[1, 2] = out[2, 0] * out[0, 1] - out[0, 0] * out[2, 1]
    out[2, 2] = out[0, 0] * out[1, 1] - out[1, 0] * out[0, 1]


@kernel
def cap_norm(vector, first, cap):
    """Shorten three entries of `vector`, from `first` on, to a length of `cap` at most."""
    x, y, z = vector[first], vector[first + 1], vector[first + 2]
    n = math.sqrt(x * x + y * y + z * z)
    if n > cap:
        for i in range(first, first + 3):
            vector[i] *= cap / n


@kernel
def limit_torque(ctl):
    """Limit the wanted torque: magnitude, then change since the last tick, then magnitude again."""
    for i in range(ctl.tau.shape[0]):
        limit, step, last = ctl.tau_max[i], ctl.tau_step_max[i], ctl.tau[i]
        wanted = min(max(ctl.tau_wanted[i], -limit), limit)
        wanted = min(max(wanted, last - step), last + step)
        ctl.tau[i] = min(max(wanted, -limit), limit)
