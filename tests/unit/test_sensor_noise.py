"""The sensor's faults, each alone: they are what processing has to find."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from wrenchflow.sim.ft_sensor import SensorFaults, make_sensor, read_sensor

NONE = SensorFaults(
    bias_force_n=0.0, bias_torque_nm=0.0, drift_n_min=0.0, drift_nm_min=0.0, quantum_n=0.0, quantum_nm=0.0
)


def readings(sensor, faults: SensorFaults, true: np.ndarray, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    state = make_sensor(sensor, faults, rng, 0.001)
    white, out = rng.normal(size=true.shape), np.empty_like(true)
    for i in range(len(true)):
        read_sensor(true[i], white[i], state[0], out[i])
    return out


def test_a_perfect_sensor_reads_the_truth(quiet_rig):
    true = np.tile([1.0, -2.0, 30.0, 0.1, 0.0, -0.5], (50, 1))
    np.testing.assert_allclose(readings(quiet_rig.sensor, NONE, true), true, atol=1e-12)


def test_bias_is_constant_and_drawn_for_each_power_up(quiet_rig):
    faults = replace(NONE, bias_force_n=2.0, bias_torque_nm=0.1)
    drawn = np.array([readings(quiet_rig.sensor, faults, np.zeros((3, 6)), seed) for seed in range(200)])
    assert (drawn == drawn[:, :1]).all()
    assert np.abs(drawn).max(axis=(0, 1)) == pytest.approx([2.0] * 3 + [0.1] * 3, rel=0.05)
    assert np.abs(drawn[:, 0].mean(0) / [2.0, 2.0, 2.0, 0.1, 0.1, 0.1]).max() < 0.15


def test_noise_is_white_and_of_the_size_that_the_rig_states(rig):
    noise = readings(rig.sensor, NONE, np.zeros((20_000, 6)))
    np.testing.assert_allclose(noise.std(0), rig.sensor.noise, rtol=0.03)
    lagged = (noise[1:] * noise[:-1]).mean(0) / noise.var(0)
    assert np.abs(lagged).max() < 0.03


def test_drift_is_a_straight_line(quiet_rig):
    faults = replace(NONE, drift_n_min=0.05, drift_nm_min=0.002)
    after = np.array([readings(quiet_rig.sensor, faults, np.zeros((600, 6)), seed)[[299, 599]] for seed in range(100)])
    np.testing.assert_allclose(after[:, 1], 2.0 * after[:, 0], atol=1e-12)
    # 600 samples are a hundredth of a minute.
    np.testing.assert_allclose(after[:, 1].std(0), np.repeat([0.05, 0.002], 3) / 100.0, rtol=0.25)


def test_readings_come_in_whole_quanta(quiet_rig):
    faults = replace(NONE, quantum_n=0.25, quantum_nm=0.01)
    true = np.random.default_rng(0).normal(size=(1, 6)).repeat(5, axis=0)
    steps = readings(quiet_rig.sensor, faults, true) / np.repeat([0.25, 0.01], 3)
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-9)
    np.testing.assert_allclose(steps[-1], np.rint(true[-1] / np.repeat([0.25, 0.01], 3)), atol=1e-9)


def test_readings_stop_at_the_range(quiet_rig):
    true = np.tile([1e3, -1e3, 0.0, 1e2, -1e2, 0.0], (3, 1))
    np.testing.assert_array_equal(readings(quiet_rig.sensor, NONE, true)[-1], [200, -200, 0, 10, -10, 0])


def test_the_low_pass_is_a_second_order_butterworth(quiet_rig):
    true = np.random.default_rng(0).normal(size=(500, 6))
    true[0] = 0.0  # From rest, so that both begin in the same state.
    sections = butter(2, quiet_rig.sensor.lowpass_hz, fs=1000.0, output="sos")
    np.testing.assert_allclose(readings(quiet_rig.sensor, NONE, true), sosfilt(sections, true, axis=0), atol=1e-12)


def test_a_recording_does_not_begin_with_a_transient(quiet_rig):
    true = np.full((20, 6), 5.0)
    np.testing.assert_allclose(readings(quiet_rig.sensor, NONE, true), true, atol=1e-12)
