"""The force that the safety layer feels: from the sensor's own reading, by its own tare, past no other stage.

A policy sees force through `process`; this is apart from it on purpose, for safety trusts nobody. The bias is the mean
reading while the arm waits for its first request, less the payload's weight. Two second-order low-passes follow: 50 Hz
for what presses, 200 Hz for what hits.
"""

import math

from wrenchflow.compiled import kernel
from wrenchflow.control.gate import all_finite
from wrenchflow.filtering import filter_sample
from wrenchflow.so3 import multiply_into

# Kernels read this; it is one of the files that `wrenchflow.compiled` looks at for changes.
GRAVITY_M_S2 = 9.81
_BIAS_TICKS = 1000  # The bias is the mean of about the last second.


@kernel
def feel(obs, ctl):
    """Take in one reading: `ctl.wrench` and `ctl.impact`, or a tick more without one in `ctl.dead_ticks`."""
    raw, last = obs.wrench, ctl.wrench_raw_last
    if not all_finite(raw):
        ctl.dead_ticks += 1
        return
    ctl.dead_ticks = 0
    R, unloaded = ctl.matrices[0], ctl.sample
    multiply_into(obs.R, ctl.R_tcp_sensor, R)
    _unload(ctl, raw, R, unloaded)
    if ctl.takes_bias and ctl.is_waiting:
        ctl.bias_ticks = min(ctl.bias_ticks + 1, _BIAS_TICKS)
        for i in range(6):
            ctl.bias[i] += unloaded[i] / ctl.bias_ticks
            unloaded[i] -= unloaded[i] / ctl.bias_ticks
    for i in range(6):
        ctl.frozen_ticks[i] = ctl.frozen_ticks[i] + 1 if raw[i] == last[i] else 0
        last[i] = raw[i]
    # About the TCP: m_tcp = m_sensor + (sensor from TCP) x f, then all of it in base axes.
    arm, moved = ctl.x_tcp_sensor, ctl.vector
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        moved[i] = unloaded[i]
        moved[3 + i] = unloaded[3 + i] + arm[j] * unloaded[k] - arm[k] * unloaded[j]
    for i in range(3):
        unloaded[i] = R[i, 0] * moved[0] + R[i, 1] * moved[1] + R[i, 2] * moved[2]
        unloaded[3 + i] = R[i, 0] * moved[3] + R[i, 1] * moved[4] + R[i, 2] * moved[5]
    filter_sample(ctl.impact_sos, ctl.impact_state, unloaded[:3], ctl.impact)
    filter_sample(ctl.wrench_sos, ctl.wrench_state, unloaded, ctl.wrench)


@kernel
def _unload(ctl, raw, R, out):
    """Set out = raw - bias - the payload's weight, in the sensor frame: what hangs still reads its weight, upwards."""
    com = ctl.payload_com
    for i in range(3):
        out[i] = ctl.payload_kg * GRAVITY_M_S2 * R[2, i]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        out[3 + i] = com[j] * out[k] - com[k] * out[j]
    for i in range(6):
        out[i] = raw[i] - ctl.bias[i] - out[i]


@kernel
def length(vector, first):
    """Length of three entries, from `first` on."""
    x, y, z = vector[first], vector[first + 1], vector[first + 2]
    return math.sqrt(x * x + y * y + z * z)
