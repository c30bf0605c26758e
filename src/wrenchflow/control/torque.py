"""The last limits: of force before it becomes torque, of torque, and of its change."""

import math

from wrenchflow.compiled import kernel
from wrenchflow.control.gate import is_on, note
from wrenchflow.control.safeguards import GATE_TORQUE, TORQUE, TORQUE_RATE


@kernel
def cap_norm(vector, first, cap):
    """Shorten three entries of `vector`, from `first` on, to a length of `cap` at most; returns whether it did."""
    x, y, z = vector[first], vector[first + 1], vector[first + 2]
    n = math.sqrt(x * x + y * y + z * z)
    if n > cap:
        for i in range(first, first + 3):
            vector[i] *= cap / n
    return n > cap


@kernel
def limit_torque(ctl):
    """Limit the wanted torque: magnitude, then change since the last tick, then magnitude again; NaN is none at all."""
    for i in range(ctl.tau.shape[0]):
        limit, step, last = ctl.tau_max[i], ctl.tau_step_max[i], ctl.tau[i]
        wanted = ctl.tau_wanted[i]
        if not math.isfinite(wanted) and is_on(ctl, GATE_TORQUE):
            wanted = 0.0
        if is_on(ctl, TORQUE) and abs(wanted) > limit:
            note(ctl, TORQUE)
            wanted = min(max(wanted, -limit), limit)
        if is_on(ctl, TORQUE_RATE) and abs(wanted - last) > step:
            note(ctl, TORQUE_RATE)
            wanted = min(max(wanted, last - step), last + step)
        ctl.tau[i] = min(max(wanted, -limit), limit) if is_on(ctl, TORQUE) else wanted
