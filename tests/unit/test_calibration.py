from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from wrenchflow.errors import CalibrationError, ConfigError, StreamError
from wrenchflow.process.calibration import bias_window, estimate_bias
from wrenchflow.process.config import BiasConfig
from wrenchflow.process.payload import identify_payload
from wrenchflow.rig import Payload, load_rig


def estimate(episode, seconds=0.5, **options):
    rig = load_rig("panda_peg")
    start_ns = int(episode["wrench_raw"].t[0])
    joints = options.pop("joints", episode["joint_states"])
    return estimate_bias(
        episode["wrench_raw"],
        episode["tcp_pose"],
        joints,
        options.pop("rig", rig),
        start_ns=start_ns,
        stop_ns=start_ns + round(seconds * 1e9),
        **options,
    )


def altered(episode, name, change):
    data = episode[name].data.copy()
    change(data)
    return episode.with_stream(name, replace(episode[name], data=data))


def test_the_bias_is_that_of_the_sensor_without_the_payload(recording, true_bias):
    rig = load_rig("panda_peg")
    bias = estimate(recording())
    np.testing.assert_allclose(bias.mean, true_bias, atol=5 * rig.sensor.noise[0] / np.sqrt(500))
    np.testing.assert_allclose(bias.std, rig.sensor.noise, rtol=0.2)
    assert bias.samples == 500
    assert (np.abs(bias.slope_per_min * 0.5 / 60) < 5 * rig.sensor.noise * np.sqrt(12 / 500)).all()


def test_a_force_sensor_has_a_bias_of_three_axes(recording, true_bias):
    bias = estimate(recording(force_only=True))
    np.testing.assert_allclose(bias.mean, true_bias[:3], atol=0.05)


def test_the_tare_phase_is_the_window_and_else_the_start(recording):
    episode = recording()
    start_ns = int(episode["wrench_raw"].t[0])
    assert bias_window(episode, BiasConfig(window_s=0.3)) == (start_ns, start_ns + 500_000_000)
    assert bias_window(replace(episode, events=()), BiasConfig(window_s=0.3)) == (start_ns, start_ns + 300_000_000)


def test_a_slow_drift_within_the_noise_is_measured(recording):
    ramp = np.linspace(0, 0.2, 2000)[:, None] * np.array([1.0, 0, 0, 0, 0, 0])
    episode = altered(recording(noise=0.1), "wrench_raw", lambda data: data.__iadd__(ramp))
    assert estimate(episode, seconds=0.9).slope_per_min[0] == pytest.approx(0.2 / 2.0 * 60, rel=0.1)


def test_a_short_window_is_refused(recording):
    with pytest.raises(CalibrationError, match=r"too short: got 0\.199 s .* expected 0\.2 s at least"):
        estimate(recording(), seconds=0.199)
    estimate(recording(), seconds=0.2)


def test_samples_that_are_not_finite_or_have_no_pose_do_not_count(recording):
    episode = altered(recording(), "wrench_raw", lambda data: data.__setitem__((slice(0, 301), 0), np.nan))
    with pytest.raises(CalibrationError, match=r"got 0\.199 s of finite samples"):
        estimate(episode)
    pose = recording()["tcp_pose"]
    late = recording().with_stream("tcp_pose", pose.between(int(pose.t[301]), int(pose.t[-1])))
    with pytest.raises(CalibrationError, match=r"got 0\.199 s .* with a known pose"):
        estimate(late)


@pytest.mark.parametrize("velocity", [0.02, -0.02, np.nan])
def test_moving_joints_are_refused(recording, velocity):
    episode = altered(recording(), "joint_states", lambda data: data.__setitem__((250, 7 + 3), velocity))
    with pytest.raises(CalibrationError, match=r"joints move .* rad/s in dq4, expected 0\.01 rad/s"):
        estimate(episode)
    estimate(episode, joints=None)


def test_joints_that_nobody_saw_are_not_at_rest(recording):
    joints = recording()["joint_states"]
    with pytest.raises(CalibrationError, match="no sample of the joints"):
        estimate(recording(), joints=joints.between(int(joints.t[600]), int(joints.t[-1])))


def test_a_spread_beyond_twice_the_noise_is_refused(recording):
    shake = 0.7 * np.sin(np.arange(2000) * 0.9)
    episode = altered(recording(), "wrench_raw", lambda data: data.__setitem__((slice(None), 1), data[:, 1] + shake))
    with pytest.raises(CalibrationError, match=r"spreads .* N standard deviation in fy, expected 0\.4 N at most"):
        estimate(episode)


def test_a_drifting_window_is_refused(recording):
    ramp = np.linspace(0, 0.08, 2000)
    episode = altered(recording(), "wrench_raw", lambda data: data.__setitem__((slice(None), 4), data[:, 4] + ramp))
    with pytest.raises(CalibrationError, match=r"drifts .* N.m of drift in ty, expected 0\.014 N.m at most"):
        estimate(episode)


def test_a_contact_or_a_wrong_payload_is_refused(recording):
    episode = altered(recording(), "wrench_raw", lambda data: data.__setitem__((slice(None), 2), data[:, 2] - 24.0))
    with pytest.raises(CalibrationError, match=r"loaded .* -22\S* N without the payload in fz, expected 2\.2 N"):
        estimate(episode)
    rig = load_rig("panda_peg")
    with pytest.raises(CalibrationError, match="a wrong payload, or a contact"):
        estimate(recording(), rig=replace(rig, payload=Payload(mass_kg=0.0, com_sensor_m=(0.0, 0.0, 0.0))))


def test_a_stream_that_is_no_raw_wrench_is_refused(recording):
    episode = recording()
    with pytest.raises(StreamError, match="must be a wrench or a force, got a 'pose'"):
        estimate(episode.with_stream("wrench_raw", episode["tcp_pose"]))
    with pytest.raises(StreamError, match="frame 'sensor', got 'base'"):
        estimate(episode.with_stream("wrench_raw", replace(episode["wrench_raw"], frame="base")))


def test_an_impossible_window_is_refused():
    with pytest.raises(ConfigError, match=r"at least bias\.min_window_s"):
        BiasConfig(window_s=0.1)


# ---- payload


def orientations(rng, count):
    """The tool points down, tilted by up to 60 deg."""
    tilts = Rotation.from_rotvec(np.column_stack([rng.uniform(-1, 1, (count, 2)), np.zeros(count)]))
    return Rotation.from_euler("x", np.pi) * tilts


def rests(rng, raw_wrench, true_bias, count=8, noise=None):
    rig = load_rig("panda_peg")
    rotations = orientations(rng, count)
    zero = np.zeros((1, 3))
    readings = np.vstack([raw_wrench(rig, R, zero, zero) for R in rotations]) + true_bias
    R_tcp_flange = Rotation.from_quat(rig.T_flange_tcp[3:], scalar_first=True).inv()
    R_flange_sensor = Rotation.from_quat(rig.sensor.T_flange_sensor[3:], scalar_first=True)
    matrices = np.stack([(R * R_tcp_flange * R_flange_sensor).as_matrix() for R in rotations])
    return rig, matrices, readings if noise is None else readings + noise * rng.normal(size=readings.shape)


def test_a_payload_is_found_exactly_without_noise(raw_wrench, true_bias):
    rig, R, readings = rests(np.random.default_rng(0), raw_wrench, true_bias, count=4)
    found = identify_payload(R, readings, rig.sensor.noise)
    assert found.payload.mass_kg == pytest.approx(rig.payload.mass_kg, abs=1e-9)
    np.testing.assert_allclose(found.payload.com_sensor_m, rig.payload.com_sensor_m, atol=1e-9)
    np.testing.assert_allclose(found.bias, true_bias, atol=1e-9)
    np.testing.assert_allclose(found.residual, 0.0, atol=1e-9)


def test_a_payload_is_found_within_its_own_covariance(raw_wrench, true_bias):
    rng = np.random.default_rng(1)
    errors = []
    for _ in range(200):
        noise = np.repeat([0.02, 0.001], 3)
        rig, R, readings = rests(rng, raw_wrench, true_bias, noise=noise)
        found = identify_payload(R, readings, noise)
        mass_kg, com_m = rig.payload.mass_kg, np.array(rig.payload.com_sensor_m)
        truth = np.concatenate([[mass_kg], mass_kg * com_m, true_bias])
        got = np.concatenate(
            [[found.payload.mass_kg], found.payload.mass_kg * np.array(found.payload.com_sensor_m), found.bias]
        )
        errors.append((got - truth) @ np.linalg.solve(found.covariance, got - truth))
        assert abs(found.payload.mass_kg - mass_kg) < 5 * found.mass_std_kg
        assert (np.abs(found.payload.com_sensor_m - com_m) < 5 * found.com_std_m).all()
    # The squared error in units of the covariance has ten degrees of freedom: mean 10, standard deviation sqrt(20).
    assert np.mean(errors) == pytest.approx(10.0, abs=4 * np.sqrt(20 / 200))


def test_too_few_or_too_similar_orientations_are_refused(raw_wrench, true_bias):
    rng = np.random.default_rng(2)
    rig, R, readings = rests(rng, raw_wrench, true_bias, count=3)
    with pytest.raises(CalibrationError, match="4 orientations at least, got 3"):
        identify_payload(R, readings, rig.sensor.noise)
    turns = (Rotation.from_euler("x", np.pi) * Rotation.from_euler("z", rng.uniform(-1, 1, 6)[:, None])).as_matrix()
    with pytest.raises(CalibrationError, match="too few directions: got a condition number of"):
        identify_payload(turns, np.zeros((6, 6)), rig.sensor.noise)


def test_a_sign_that_makes_the_mass_negative_is_refused(raw_wrench, true_bias):
    rig, R, readings = rests(np.random.default_rng(3), raw_wrench, true_bias)
    with pytest.raises(CalibrationError, match="expected more than 0"):
        identify_payload(R, -readings, rig.sensor.noise)
