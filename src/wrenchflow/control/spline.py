"""The way between knots, with a continuous velocity: position by cubics in R3, rotation by cubics in its logarithm.

Between knots i and i + 1, h apart, x(s) is the cubic Hermite curve, and R(s) = exp(phi(s)) R_i with phi the one from 0
to log(R_i+1 R_i^T). The velocity at a knot is the mean of the two secants' that meet there, each weighted by the other
one's interval (Catmull and Rom's tangent for stamps that are not evenly spaced); the angular velocity w is continuous
because phi ends with the rate J_l(phi)^-1 w. The first and the last knot stand still.

A velocity is never more than `STEEPEST` times that of the slower secant (the bound of Fritsch and Carlson, by length).
So a curve leaves its chord by 3/4 of the chord's length at most, and after a short steep stretch it does not fly on.
"""

import math

from wrenchflow.compiled import kernel
from wrenchflow.so3 import exp_into, log_into, multiply_into, multiply_transposed_into

STEEPEST = 3.0
NS = 1e-9


@kernel
def fit(knots, matrix, vector):
    """Work out the velocities at the knots, and the turn of each segment, from stamps and poses.

    Args:
        knots: Record with count, t [ns], x, R; velocity, spin, turn and spin_stop are written.
        matrix: (3, 3), to work with.
        vector: (4,), to work with.
    """
    last = knots.count - 1
    for i in range(last):
        multiply_transposed_into(knots.R[i + 1], knots.R[i], matrix)
        log_into(matrix, vector)
        for k in range(3):
            knots.turn[i, k] = vector[k]
    for i in range(knots.count):
        for k in range(3):
            knots.velocity[i, k], knots.spin[i, k] = 0.0, 0.0
        if 0 < i < last:
            before_s, after_s = (knots.t[i] - knots.t[i - 1]) * NS, (knots.t[i + 1] - knots.t[i]) * NS
            for k in range(3):
                vector[k] = knots.x[i, k] - knots.x[i - 1, k]
                matrix[0, k] = knots.x[i + 1, k] - knots.x[i, k]
            _tangent(vector, before_s, matrix[0], after_s, knots.velocity[i])
            _tangent(knots.turn[i - 1], before_s, knots.turn[i], after_s, knots.spin[i])
    for i in range(last):
        _rate_of_spin(knots.turn[i], knots.spin[i + 1], knots.spin_stop[i])


@kernel
def _tangent(before, before_s, after, after_s, out):
    for k in range(3):
        out[k] = (after_s * (before[k] / before_s) + before_s * (after[k] / after_s)) / (before_s + after_s)
    speed, most = _norm(out), STEEPEST * min(_norm(before) / before_s, _norm(after) / after_s)
    if speed > most:
        for k in range(3):
            out[k] *= most / speed


@kernel
def _norm(v):
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@kernel
def _rate_of_spin(phi, spin, out):
    # J_l(phi)^-1 w = w - 1/2 phi x w + c phi x (phi x w), c = (1 - a/2 cot(a/2)) / a^2 with a = |phi|.
    angle = _norm(phi)
    half = 0.5 * angle
    c = 1.0 / 12.0 if angle < 1e-4 else (1.0 - half * math.cos(half) / math.sin(half)) / (angle * angle)
    ux = phi[1] * spin[2] - phi[2] * spin[1]
    uy = phi[2] * spin[0] - phi[0] * spin[2]
    uz = phi[0] * spin[1] - phi[1] * spin[0]
    out[0] = spin[0] - 0.5 * ux + c * (phi[1] * uz - phi[2] * uy)
    out[1] = spin[1] - 0.5 * uy + c * (phi[2] * ux - phi[0] * uz)
    out[2] = spin[2] - 0.5 * uz + c * (phi[0] * uy - phi[1] * ux)


@kernel
def locate(knots, t_ns):
    """The knot that a time is at or after, and the share of the way to the next; 0 before the first and at the last."""
    i = 0
    while i + 1 < knots.count and knots.t[i + 1] <= t_ns:
        i += 1
    if i + 1 == knots.count or t_ns <= knots.t[i]:
        return i, 0.0
    return i, (t_ns - knots.t[i]) / (knots.t[i + 1] - knots.t[i])


@kernel
def place(knots, i, share, matrix, x, R):
    """Pose at a share of the way from knot `i` to the next, into `x` (3,) and `R` (3, 3); `matrix` is to work with."""
    if share == 0.0:
        for k in range(3):
            x[k] = knots.x[i, k]
            for m in range(3):
                R[k, m] = knots.R[i, k, m]
        return
    h = (knots.t[i + 1] - knots.t[i]) * NS
    for k in range(3):
        step = knots.x[i + 1, k] - knots.x[i, k]
        x[k] = knots.x[i, k] + _cubic(share, step, h * knots.velocity[i, k], h * knots.velocity[i + 1, k])
    exp_into(
        _cubic(share, knots.turn[i, 0], h * knots.spin[i, 0], h * knots.spin_stop[i, 0]),
        _cubic(share, knots.turn[i, 1], h * knots.spin[i, 1], h * knots.spin_stop[i, 1]),
        _cubic(share, knots.turn[i, 2], h * knots.spin[i, 2], h * knots.spin_stop[i, 2]),
        matrix,
    )
    multiply_into(matrix, knots.R[i], R)


@kernel
def _cubic(s, step, rate_start, rate_stop):
    # From 0 to `step`, with these rates a segment at its ends.
    curve = 3.0 * step - 2.0 * rate_start - rate_stop
    return s * (rate_start + s * (curve + s * (rate_start + rate_stop - 2.0 * step)))
