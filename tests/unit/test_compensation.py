from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from wrenchflow.episode import Stream
from wrenchflow.errors import StreamError
from wrenchflow.filtering import lowpass, zero_phase
from wrenchflow.force_filter import FilterConfig
from wrenchflow.process.calibration import Bias
from wrenchflow.process.compensation import WrenchPipeline
from wrenchflow.process.config import InertiaConfig
from wrenchflow.process.filters import causal_wrench
from wrenchflow.process.filters import zero_phase_wrench as zero_phase_and_more
from wrenchflow.process.stamps import held_pose
from wrenchflow.rig import load_rig
from wrenchflow.signals import POSE, WRENCH

RIG = load_rig("panda_peg")
# Mounts that are turned and off centre, so that no transform can be left out unseen.
SKEW = replace(
    RIG,
    T_flange_tcp=(0.01, -0.02, 0.16, *Rotation.from_rotvec([0.3, 0.1, -0.4]).as_quat(scalar_first=True)),
    sensor=replace(
        RIG.sensor, T_flange_sensor=(0.003, 0.001, 0.04, *Rotation.from_rotvec([0, 0, 0.8]).as_quat(scalar_first=True))
    ),
    payload=replace(RIG.payload, com_sensor_m=(0.01, -0.015, 0.05)),
)
ZERO = np.zeros(6)
FILTER = FilterConfig()


def zero_phase_wrench(raw, pose, rig, bias, filter):
    """Without a twist nothing is known of inertia."""
    return zero_phase_and_more(raw, pose, None, rig, bias, filter, InertiaConfig()).wrench


def random_rotations(seed, count):
    return Rotation.random(count, rng=np.random.default_rng(seed))


@pytest.mark.parametrize("rig", [RIG, SKEW])
def test_a_hanging_tool_weighs_nothing_at_any_orientation(raw_wrench, rig):
    rotations = random_rotations(0, 500)
    none = np.zeros((500, 3))
    pipeline = WrenchPipeline(rig, ZERO)
    clean = pipeline.compensate(raw_wrench(rig, rotations, none, none), rotations.as_quat(scalar_first=True))
    np.testing.assert_allclose(clean, 0.0, atol=1e-12)


@pytest.mark.parametrize("rig", [RIG, SKEW])
def test_a_known_push_is_recovered_about_the_tcp_in_base_axes(raw_wrench, true_bias, rig):
    rng = np.random.default_rng(1)
    rotations = random_rotations(1, 500)
    force_n, at_m = rng.uniform(-10, 10, (500, 3)), rng.uniform(-0.05, 0.05, (500, 3))  # `at_m`: from the tcp
    moment_nm = np.cross(at_m, force_n)
    raw = raw_wrench(rig, rotations, force_n, moment_nm) + true_bias
    clean = WrenchPipeline(rig, true_bias).compensate(raw, rotations.as_quat(scalar_first=True))
    np.testing.assert_allclose(clean, np.hstack([force_n, moment_nm]), atol=1e-12)


def test_pressing_down_on_a_table_is_a_negative_fz():
    # By hand: the tool points down, the sensor's z with it. 0.5 kg would hang on it with +4.905 N along base z, which
    # is -4.905 along sensor z. The table pushes the robot up with 10 N, so the robot exerts -10 N along base z: +10.
    rig = replace(RIG, payload=replace(RIG.payload, mass_kg=0.5, com_sensor_m=(0.0, 0.0, 0.05)))
    raw = np.array([[0.0, 0.0, -4.905 + 10.0, 0.0, 0.0, 0.0]])
    clean = WrenchPipeline(rig, ZERO).compensate(raw, np.array([[0.0, 1.0, 0.0, 0.0]]))
    np.testing.assert_allclose(clean, [[0, 0, -10, 0, 0, 0]], atol=1e-12)


@given(st.integers(0, 1000), st.lists(st.integers(0, 300), max_size=8).map(sorted), st.sampled_from([3, 6]))
def test_any_chunking_gives_the_bits_of_the_whole(seed, cuts, width):
    rng = np.random.default_rng(seed)
    steps = np.where(rng.random(300) < 0.02, rng.integers(2, 50, 300), 1)  # with gaps
    t = np.cumsum(steps) * 1_000_000
    raw = rng.normal(size=(300, width))
    raw[rng.random(300) < 0.02] = np.nan
    quat = random_rotations(seed, 300).as_quat(scalar_first=True)
    whole = WrenchPipeline(SKEW, rng.normal(size=width))
    running = WrenchPipeline(SKEW, whole._bias)
    parts = [running.push(*part) for part in zip(*(np.split(array, cuts) for array in (t, raw, quat)), strict=True)]
    assert np.concatenate(parts).tobytes() == whole.push(t, raw, quat).tobytes()


def test_offline_is_live(recording, true_bias):
    """A running robot that is fed chunk by chunk gets the bits that `process` writes."""
    episode = recording()
    raw, pose = episode["wrench_raw"], episode["tcp_pose"]
    offline = causal_wrench(raw, pose, RIG, true_bias_of(true_bias), FILTER)
    live = WrenchPipeline(RIG, true_bias)
    _, held = held_pose(pose, raw.t)
    rows = [live.push(raw.t[i : i + 17], raw.data[i : i + 17], held[i : i + 17, 3:]) for i in range(0, len(raw), 17)]
    assert np.concatenate(rows).tobytes() == offline.data.tobytes()
    assert (offline.frame, offline.signal) == ("base", WRENCH)


def true_bias_of(mean):
    zero = np.zeros_like(mean)
    return Bias(mean=mean, std=zero, slope_per_min=zero, start_ns=0, stop_ns=1, samples=1)


def test_a_push_is_recovered_from_a_recording_within_2_percent_or_50_mn(recording, true_bias):
    episode = recording(push_n=(1.0, 3.0, -10.0))
    bias = true_bias_of(true_bias)
    for run in (causal_wrench, zero_phase_wrench):
        clean = run(episode["wrench_raw"], episode["tcp_pose"], RIG, bias, FILTER)
        got = clean.data[1100:1450, :3].mean(axis=0)
        np.testing.assert_allclose(got, [1.0, 3.0, -10.0], rtol=0.02, atol=0.05)
        np.testing.assert_allclose(clean.data[1100:1450, 3:].mean(axis=0), 0.0, atol=0.005)


def test_a_force_sensor_takes_the_same_path_on_three_columns(recording, true_bias):
    six, three = recording(), recording(force_only=True)
    for run in (causal_wrench, zero_phase_wrench):
        clean = run(six["wrench_raw"], six["tcp_pose"], RIG, true_bias_of(true_bias), FILTER)
        force = run(three["wrench_raw"], three["tcp_pose"], RIG, true_bias_of(true_bias[:3]), FILTER)
        assert force.signal.columns == ("fx", "fy", "fz")
        assert force.data.tobytes() == np.ascontiguousarray(clean.data[:, :3]).tobytes()


def test_the_pose_of_a_sample_is_the_last_one_before_it(recording, true_bias):
    t = np.array([10, 20, 30], np.int64)
    pose = Stream(t, np.column_stack([np.arange(9.0).reshape(3, 3), np.tile([0.6, 0.8, 0, 0], (3, 1))]), POSE, "base")
    before, held = held_pose(pose, np.array([5, 9, 10, 19, 20, 99]))
    assert before == 2
    np.testing.assert_array_equal(held, pose.data[[0, 0, 1, 2]])

    episode = recording()
    late = episode["tcp_pose"].between(int(episode["tcp_pose"].t[100]), 2**62)
    clean = causal_wrench(episode["wrench_raw"], late, RIG, true_bias_of(true_bias), FILTER)
    assert clean.t[0] == late.t[0]


def test_a_gap_starts_the_filter_anew(recording, true_bias):
    episode = recording()
    raw = episode["wrench_raw"]
    keep = np.r_[0:1200, 1230:2000]
    gappy = replace(raw, t=raw.t[keep], data=raw.data[keep])
    clean = causal_wrench(gappy, episode["tcp_pose"], RIG, true_bias_of(true_bias), FILTER)
    unfiltered = WrenchPipeline(RIG, true_bias).compensate(gappy.data, episode["tcp_pose"].data[keep, 3:])
    assert clean.data[:1200].tobytes() == lowpass(unfiltered[:1200], 40.0, 1000.0).tobytes()
    assert clean.data[1200:].tobytes() == lowpass(unfiltered[1200:], 40.0, 1000.0).tobytes()
    labels = zero_phase_wrench(gappy, episode["tcp_pose"], RIG, true_bias_of(true_bias), FILTER)
    np.testing.assert_array_equal(labels.t, clean.t)
    expected = [zero_phase(part, 40.0, 1000.0) for part in np.split(unfiltered, [1200])]
    np.testing.assert_array_equal(labels.data, np.concatenate(expected))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_left_out_and_does_not_spread(recording, true_bias, value):
    episode = recording()
    data = episode["wrench_raw"].data.copy()
    data[700, 1] = value
    raw = replace(episode["wrench_raw"], data=data)
    for run in (causal_wrench, zero_phase_wrench):
        clean = run(raw, episode["tcp_pose"], RIG, true_bias_of(true_bias), FILTER)
        assert len(clean) == 1999
        assert raw.t[700] not in clean.t
        assert np.isfinite(clean.data).all()


def test_uneven_sampling_is_refused_in_one_line(recording, true_bias):
    episode = recording()
    raw = episode["wrench_raw"]
    jitter = np.random.default_rng(0).integers(-400_000, 400_000, len(raw))
    slow = np.arange(len(raw)) * 1_440_000
    off_by_three_percent = np.arange(len(raw)) * 1_030_000
    for t in (raw.t + jitter, slow, off_by_three_percent):
        with pytest.raises(StreamError, match=r"'wrench_raw' is unevenly sampled: got steps of .* expected 1 ms"):
            causal_wrench(replace(raw, t=t), episode["tcp_pose"], RIG, true_bias_of(true_bias), FILTER)
    mild = np.random.default_rng(0).integers(-100_000, 100_000, len(raw))
    assert len(causal_wrench(replace(raw, t=raw.t + mild), episode["tcp_pose"], RIG, true_bias_of(true_bias), FILTER))


def test_a_pose_that_is_none_is_refused(recording, true_bias):
    episode = recording()
    data = episode["tcp_pose"].data.copy()
    data[300, 3:] = 0.0
    with pytest.raises(StreamError, match="no unit quaternion for 5300000000 ns: got length 0"):
        causal_wrench(
            episode["wrench_raw"], replace(episode["tcp_pose"], data=data), RIG, true_bias_of(true_bias), FILTER
        )
