from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from wrenchflow.collect.calibration_motion import run_motion
from wrenchflow.episode import Episode, Stream
from wrenchflow.errors import CalibrationError, StreamError
from wrenchflow.process.calibrate_config import Doubt
from wrenchflow.process.identify import identify
from wrenchflow.process.means import standard_error
from wrenchflow.process.mount import SensorMount
from wrenchflow.process.payload import identify_payload
from wrenchflow.process.rests import effective_samples, find_rests, marked_rests, standard_errors
from wrenchflow.rig import Payload, load_rig
from wrenchflow.signals import FORCE, POSE, WRENCH

RIG = load_rig("panda_peg")
TRUTH = Payload(mass_kg=0.8, com_sensor_m=(0.01, -0.02, 0.06))
REST, MOVE = 900, 400  # Samples.


@pytest.fixture(scope="module")
def motion():
    return run_motion(RIG, TRUTH, seed=1)


def altered(episode, name, change):
    data = episode[name].data.copy()
    change(data)
    return episode.with_stream(name, replace(episode[name], data=data))


def rows_of(episode, number):
    """Rows of `wrench_raw` in a rest, counted from 1."""
    start_ns, stop_ns = marked_rests(episode)[number - 1]
    return slice(*np.searchsorted(episode["wrench_raw"].t, [start_ns, stop_ns]))


def tilts(count=6):
    azimuths = np.arange(count) * 2 * np.pi / count
    vectors = 0.7 * np.column_stack([np.cos(azimuths), np.sin(azimuths), np.zeros(count)])
    return Rotation.from_rotvec(vectors) * Rotation.from_euler("x", np.pi)


def gone_through(raw_wrench, rotations, bias, *, seed=0, payload=TRUTH, alike=0.0):
    """Rests one after the other, with moves in between; `alike` is how much a sample's noise is that of the last."""
    rng, samples = np.random.default_rng(seed), len(rotations) * (REST + MOVE) + MOVE
    rig, zero = replace(RIG, payload=payload), np.zeros((1, 3))
    t = np.arange(samples, dtype=np.int64) * 1_000_000
    pose, raw = np.zeros((samples, 7)), np.zeros((samples, 6))
    for i, R in enumerate(rotations):
        part = slice(i * (REST + MOVE), None)
        pose[part] = [0.5, 0.0, 0.3, *R.as_quat(scalar_first=True)]
        raw[part] = raw_wrench(rig, R, zero, zero) + bias
        moving = slice(i * (REST + MOVE), i * (REST + MOVE) + MOVE)
        pose[moving, 0] += 0.1 * np.sin(np.arange(MOVE) * 0.1)
    pose[-MOVE:, 0] += 0.1 * np.sin(np.arange(MOVE) * 0.1)
    noise = lfilter([np.sqrt(1 - alike**2)], [1, -alike], rng.normal(size=raw.shape), axis=0)
    raw += RIG.sensor.noise * noise
    return Episode("gone", "t", {"wrench_raw": Stream(t, raw, WRENCH, "sensor"), "tcp_pose": Stream(t, pose, POSE)})


def test_the_payload_of_the_simulated_arm_is_found_within_its_own_uncertainty(motion):
    found = identify([motion], RIG).estimate
    assert abs(found.payload.mass_kg - TRUTH.mass_kg) < min(4 * found.mass_std_kg, 0.008)
    off_m = np.abs(np.subtract(found.payload.com_sensor_m, TRUTH.com_sensor_m))
    assert (off_m < np.minimum(4 * found.com_std_m, 0.002)).all()
    assert found.condition < 10.0
    assert found.scale == 1.0


def test_rests_that_nobody_marked_are_found_by_stillness(motion):
    marked = find_rests(motion, RIG)
    found = find_rests(replace(motion, events=()), RIG)
    for rest in marked:
        assert any(other.start_ns < rest.middle_ns < other.stop_ns for other in found)
    told, untold = identify([motion], RIG).estimate, identify([replace(motion, events=())], RIG).estimate
    assert untold.payload.mass_kg == pytest.approx(told.payload.mass_kg, abs=0.002)


def test_stillness_finds_each_rest_and_nothing_of_the_moves(raw_wrench, true_bias):
    rests = find_rests(gone_through(raw_wrench, tilts(), true_bias), RIG)
    assert len(rests) == 6
    for i, rest in enumerate(rests):
        begin_ns = (i * (REST + MOVE) + MOVE) * 1_000_000
        assert begin_ns <= rest.start_ns < rest.stop_ns <= begin_ns + REST * 1_000_000
        assert rest.samples >= 300


def test_covariance_covers_noise_tilt_and_drift():
    rng, errors, doubt = np.random.default_rng(0), [], Doubt(orientation_rad=2e-3, drift_n_min=0.2, drift_nm_min=0.01)
    R, noise, minutes = tilts(8).as_matrix(), np.repeat([0.006, 0.0002], 3), np.arange(8) * 0.08
    true_rig = replace(RIG, payload=TRUTH)
    for _ in range(300):
        turn = Rotation.from_rotvec(rng.normal(size=3) * doubt.orientation_rad / np.sqrt(3)).as_matrix()
        bias = rng.uniform(-1, 1, 6)
        drift = rng.normal(size=6) * np.repeat([doubt.drift_n_min, doubt.drift_nm_min], 3)
        readings = SensorMount(true_rig).weight(R @ turn) + bias + np.outer(minutes - minutes.mean(), drift)
        readings += noise * rng.normal(size=readings.shape)
        found = identify_payload(R, readings, noise, minutes=minutes, doubt=doubt)
        mass_kg = found.payload.mass_kg
        off = np.concatenate(
            [
                [mass_kg - TRUTH.mass_kg],
                mass_kg * np.array(found.payload.com_sensor_m) - TRUTH.mass_kg * np.array(TRUTH.com_sensor_m),
                found.bias - bias,
            ]
        )
        errors.append(off @ np.linalg.solve(found.covariance, off))
    # Ten degrees of freedom: mean 10, standard deviation sqrt(20).
    assert np.mean(errors) == pytest.approx(10.0, abs=4 * np.sqrt(20 / 300))


def test_residuals_that_noise_does_not_explain_raise_the_variances():
    rng, noise, R = np.random.default_rng(1), np.repeat([0.006, 0.0002], 3), tilts(8).as_matrix()
    readings = SensorMount(replace(RIG, payload=TRUTH)).weight(R)
    readings += 10.0 * noise * rng.normal(size=readings.shape)
    found, trusted = identify_payload(R, readings, noise), identify_payload(R, readings, 10.0 * noise)
    assert found.chance < 1e-6
    assert found.mass_std_kg == pytest.approx(trusted.mass_std_kg, rel=0.3)
    assert trusted.scale == 1.0


@pytest.mark.parametrize("alike", [0.0, 0.8])
def test_the_standard_error_knows_that_neighbours_are_alike(alike):
    rng = np.random.default_rng(2)
    white = rng.normal(size=(400, 1500, 1))
    windows = lfilter([np.sqrt(1 - alike**2)], [1, -alike], white, axis=1)[:, 500:]
    true = windows.mean(axis=1).std()
    told = np.sqrt(np.mean([standard_error(window, 1e-3) ** 2 for window in windows]))
    assert told == pytest.approx(true, rel=0.15)


def test_fewer_samples_are_as_good_as_independent_where_neighbours_are_alike(raw_wrench, true_bias):
    white, alike = (find_rests(gone_through(raw_wrench, tilts(), true_bias, alike=alike), RIG) for alike in (0.0, 0.8))
    # An autocorrelation of a^n leaves (1 - a) / (1 + a) of the samples.
    assert effective_samples(alike).mean() == pytest.approx(0.2 / 1.8, rel=0.4)
    assert effective_samples(white).mean() > 0.6
    assert (standard_errors(alike).mean(axis=0) > 1.8 * standard_errors(white).mean(axis=0)).all()


def test_each_recording_has_a_bias_of_its_own_and_both_tell_more(raw_wrench, true_bias):
    one = gone_through(raw_wrench, tilts(), true_bias)
    two = gone_through(raw_wrench, tilts(), -true_bias, seed=1)
    both, single = identify([one, two], RIG), identify([one], RIG)
    assert both.estimate.payload.mass_kg == pytest.approx(TRUTH.mass_kg, abs=4 * both.estimate.mass_std_kg)
    assert both.estimate.mass_std_kg < 0.85 * single.estimate.mass_std_kg
    np.testing.assert_allclose(both.estimate.bias, -true_bias, atol=0.05)
    assert both.recordings.tolist() == [0] * 6 + [1] * 6


# ---- what is refused


def test_too_few_orientations_and_orientations_all_alike_are_refused(raw_wrench, true_bias):
    with pytest.raises(CalibrationError, match=r"4 orientations at least, got 3"):
        identify([gone_through(raw_wrench, tilts(6)[:3], true_bias)], RIG)
    level = Rotation.from_euler("z", np.linspace(-1, 1, 6)[:, None]) * Rotation.from_euler("x", np.pi)
    with pytest.raises(CalibrationError, match="too few directions"):
        identify([gone_through(raw_wrench, level, true_bias)], RIG)


def test_an_arm_that_never_rests_is_refused(raw_wrench, true_bias):
    episode = gone_through(raw_wrench, tilts(), true_bias)
    sway = 0.05 * np.sin(np.arange(len(episode["tcp_pose"])) * 0.01)
    with pytest.raises(CalibrationError, match="never rests"):
        identify([altered(episode, "tcp_pose", lambda data: data.__setitem__((slice(None), 1), sway))], RIG)


@pytest.mark.parametrize(("column", "size"), [(0, 1.0), (2, -1.5), (4, 0.15)])
def test_a_contact_in_a_rest_is_refused_with_its_number(motion, column, size):
    rows = rows_of(motion, 3)
    touched = altered(motion, "wrench_raw", lambda data: data.__setitem__((rows, column), size + data[rows, column]))
    with pytest.raises(CalibrationError, match=r"rest 3 of 6 is off by .* something touched the tool"):
        identify([touched], RIG)


def test_a_contact_that_begins_within_a_rest_is_refused(motion):
    rows = rows_of(motion, 4)
    late = slice(rows.stop - 500, rows.stop)
    touched = altered(motion, "wrench_raw", lambda data: data.__setitem__((late, 1), data[late, 1] + 2.0))
    with pytest.raises(CalibrationError, match=r"rest 4 of 6 cannot be used: the reading spreads"):
        identify([touched], RIG)


def test_joints_that_move_in_a_marked_rest_are_refused(motion):
    rows = rows_of(motion, 2)
    moved = altered(motion, "joint_states", lambda data: data.__setitem__((rows.start + 100, 7 + 3), 0.05))
    with pytest.raises(CalibrationError, match=r"rest 2 of 6 cannot be used: the joints move: got 0\.05 rad/s in dq4"):
        identify([moved], RIG)


def test_a_rest_without_finite_samples_is_refused(motion):
    spoilt = altered(motion, "wrench_raw", lambda data: data.__setitem__((rows_of(motion, 5), 0), np.nan))
    with pytest.raises(CalibrationError, match=r"rest 5 of 6 cannot be used: got 0 finite samples"):
        identify([spoilt], RIG)


def test_two_samples_are_refused(raw_wrench, true_bias):
    episode = gone_through(raw_wrench, tilts(), true_bias)
    two = {name: stream.between(0, 2_000_000) for name, stream in episode.streams.items()}
    with pytest.raises(CalibrationError, match="never rests"):
        identify([replace(episode, streams=two)], RIG)


def test_a_dead_channel_is_refused(motion):
    dead = altered(motion, "wrench_raw", lambda data: data.__setitem__((slice(None), 5), 0.25))
    with pytest.raises(CalibrationError, match="never changes in tz"):
        identify([dead], RIG)


def test_a_sign_and_a_frame_that_are_wrong_are_refused(motion):
    negative = altered(motion, "wrench_raw", lambda data: data.__imul__(-1.0))
    with pytest.raises(CalibrationError, match="expected more than 0"):
        identify([negative], RIG)

    def turn(data):
        data[:, :3] = data[:, [1, 0, 2]] * [1, -1, 1]

    with pytest.raises(CalibrationError, match="no payload explains all rests"):
        identify([altered(motion, "wrench_raw", turn)], RIG)


def test_nothing_below_the_sensor_is_refused(raw_wrench, true_bias):
    feather = Payload(mass_kg=0.0005, com_sensor_m=(0.0, 0.0, 0.05))
    nothing = gone_through(raw_wrench, tilts(), true_bias, payload=feather)
    with pytest.raises(CalibrationError, match=r"not told well enough|expected more than 0"):
        identify([nothing], RIG)


def test_forces_alone_and_poses_that_are_none_are_refused(motion):
    raw, pose = motion["wrench_raw"], motion["tcp_pose"]
    with pytest.raises(CalibrationError, match="tells no centre of mass"):
        identify([motion.with_stream("wrench_raw", Stream(raw.t, raw.data[:, :3].copy(), FORCE, "sensor"))], RIG)
    with pytest.raises(StreamError, match="no unit quaternion"):
        identify([motion.with_stream("tcp_pose", replace(pose, data=2.0 * pose.data))], RIG)
