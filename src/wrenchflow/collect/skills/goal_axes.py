"""Into the perceived goal's axes, where skills live, and back to the base, where targets do."""

from wrenchflow.compiled import kernel
from wrenchflow.so3 import exp_into, multiply_into


@kernel
def perceive_into(x, R, wrench, wrench_slow, goal_x, goal_R, seen):
    """Set `seen`, a `PERCEIVED` record, from a TCP pose and wrenches in base axes and the goal's pose."""
    for i in range(3):
        p = f = m = f_slow = m_slow = 0.0
        for k in range(3):
            g = goal_R[k, i]
            p += g * (x[k] - goal_x[k])
            f += g * wrench[k]
            m += g * wrench[3 + k]
            f_slow += g * wrench_slow[k]
            m_slow += g * wrench_slow[3 + k]
        seen.x[i] = p
        seen.wrench[i], seen.wrench[3 + i] = f, m
        seen.wrench_slow[i], seen.wrench_slow[3 + i] = f_slow, m_slow
        for j in range(3):
            seen.R[i, j] = goal_R[0, i] * R[0, j] + goal_R[1, i] * R[1, j] + goal_R[2, i] * R[2, j]


@kernel
def target_into(wanted, goal_x, goal_R, step, x_out, R_out):
    """Set the base pose of what is wanted, a `WANTED` record; `step` is room for a (3, 3) matrix."""
    exp_into(wanted.turn[0], wanted.turn[1], wanted.turn[2], step)
    multiply_into(goal_R, step, R_out)
    for i in range(3):
        s = goal_x[i]
        for k in range(3):
            s += goal_R[i, k] * wanted.x[k]
        x_out[i] = s
