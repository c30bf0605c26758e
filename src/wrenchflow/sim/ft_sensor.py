"""The wrist sensor as real ones are: low-pass, bias, drift, white noise, quantisation, saturation."""

from dataclasses import dataclass

import numpy as np

from wrenchflow.butterworth import design
from wrenchflow.compiled import kernel
from wrenchflow.errors import ConfigError
from wrenchflow.rig import Sensor

SENSOR = np.dtype(
    [
        ("bias", "f8", 6),  # [N, N.m]
        ("drift", "f8", 6),  # change of bias in one tick
        ("noise", "f8", 6),  # standard deviation of a sample
        ("quantum", "f8", 6),  # 0 for a continuous reading
        ("range", "f8", 6),
        ("b", "f8", 3),  # second-order low-pass, transposed direct form II
        ("a", "f8", 3),
        ("z1", "f8", 6),
        ("z2", "f8", 6),
        ("started", "i8"),
    ],
    align=True,
)


@dataclass(frozen=True, kw_only=True)
class SensorFaults:
    """How far a sensor is from a perfect one, beyond the noise that its data sheet (the rig) states.

    Typical figures of strain-gauge sensors: a bias of +-2 N at power-up, 0.05 N/min of drift.
    """

    bias_force_n: float = 2.0
    bias_torque_nm: float = 0.1
    drift_n_min: float = 0.05
    drift_nm_min: float = 0.002
    quantum_n: float = 0.0025
    quantum_nm: float = 0.0001


def make_sensor(sensor: Sensor, faults: SensorFaults, rng: np.random.Generator, tick_s: float) -> np.ndarray:
    """One `SENSOR` record with a bias and a drift drawn for this power-up.

    Raises:
        ConfigError: If the sensor's low-pass cannot be simulated at this tick.
    """
    if sensor.lowpass_hz * tick_s >= 0.5:
        raise ConfigError(f"sensor.lowpass_hz is {sensor.lowpass_hz:g}, expected below {0.5 / tick_s:g} in simulation.")
    record = np.zeros(1, SENSOR)
    state = record[0]
    state["bias"] = rng.uniform(-1, 1, 6) * np.repeat([faults.bias_force_n, faults.bias_torque_nm], 3)
    state["drift"] = rng.normal(size=6) * np.repeat([faults.drift_n_min, faults.drift_nm_min], 3) * tick_s / 60.0
    state["noise"], state["range"] = sensor.noise, sensor.range
    state["quantum"] = np.repeat([faults.quantum_n, faults.quantum_nm], 3)
    section = design(sensor.lowpass_hz, 1.0 / tick_s, 2)[0]
    state["b"], state["a"] = section[:3], section[3:]
    return record


@kernel
def read_sensor(true, white, state, out):
    """One sample of the sensor.

    Args:
        true: Interaction at the sensor site, sensor frame [N, N.m]. Shape (6,).
        white: Standard normal numbers. Shape (6,).
        state: A `SENSOR` record, which is advanced.
        out: The reading. Shape (6,).
    """
    b, a, z1, z2 = state.b, state.a, state.z1, state.z2
    if state.started == 0:  # Steady state of the first sample, so that a recording does not begin with a transient.
        for i in range(6):
            z2[i] = (b[2] - a[2]) * true[i]
            z1[i] = (b[1] - a[1]) * true[i] + z2[i]
        state.started = 1
    for i in range(6):
        y = b[0] * true[i] + z1[i]
        z1[i] = b[1] * true[i] - a[1] * y + z2[i]
        z2[i] = b[2] * true[i] - a[2] * y
        state.bias[i] += state.drift[i]
        y += state.bias[i] + state.noise[i] * white[i]
        if state.quantum[i] > 0.0:
            y = state.quantum[i] * np.rint(y / state.quantum[i])
        out[i] = min(max(y, -state.range[i]), state.range[i])
