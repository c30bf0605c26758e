from dataclasses import replace

import numpy as np
import pytest

from wrenchflow.episode import Event
from wrenchflow.process.calibration import bias_window, estimate_bias
from wrenchflow.process.config import BiasConfig
from wrenchflow.process.drift import BiasDrift, bias_drift
from wrenchflow.process.finding import NotAssessed
from wrenchflow.rig import rig_of

SLOPE_PER_MIN = np.array([1.5, -0.6, 0.3, 0.02, -0.01, 0.0])


def drifted(episode, slope_per_min):
    raw = episode["wrench_raw"]
    minutes = (raw.t - raw.t[0]) / 60e9
    return episode.with_stream("wrench_raw", replace(raw, data=raw.data + np.outer(minutes, slope_per_min)))


def told(episode, contacts=(), **options):
    rig = rig_of(episode.meta, "")
    start_ns, stop_ns = bias_window(episode, BiasConfig())
    streams = (episode["wrench_raw"], episode["tcp_pose"], episode["joint_states"])
    start = estimate_bias(*streams, rig, start_ns=start_ns, stop_ns=stop_ns)
    return bias_drift(episode, rig, start, contacts, **options)


def push(episode):
    t = int(episode["wrench_raw"].t[0])
    return Event(t + 1_000_000_000, t + 1_500_000_000, "contact")


def test_a_drift_is_told_within_its_own_uncertainty(recording):
    off = []
    for seed in range(20):
        episode = drifted(recording(samples=20_000, seed=seed), SLOPE_PER_MIN)
        found = told(episode, [push(episode)])
        assert isinstance(found, BiasDrift)
        off.append((found.slope_per_min - SLOPE_PER_MIN) / found.std_per_min)
    # 120 errors in units of their own standard deviations.
    assert np.std(off) == pytest.approx(1.0, abs=0.3)
    assert np.abs(off).max() < 5.0


def test_a_force_sensor_has_a_drift_of_three_axes(recording):
    found = told(drifted(recording(samples=20_000, force_only=True), SLOPE_PER_MIN[:3]), [])
    assert isinstance(found, BiasDrift)
    np.testing.assert_allclose(found.slope_per_min, SLOPE_PER_MIN[:3], atol=0.2)


def test_a_drift_beyond_what_a_bias_may_be_is_told(recording):
    found = told(drifted(recording(samples=20_000, noise=0.3), 8 * SLOPE_PER_MIN), [])
    assert isinstance(found, BiasDrift)
    np.testing.assert_allclose(found.slope_per_min, 8 * SLOPE_PER_MIN, atol=0.2)


def test_an_orientation_that_may_be_off_counts_where_the_tool_hangs_otherwise(recording):
    level, tilted = recording(samples=20_000), recording(samples=20_000)
    pose = tilted["tcp_pose"].data.copy()
    pose[10_000:, 3:] = [0.0, 0.9, 0.1, np.sqrt(1 - 0.82)]
    tilted = tilted.with_stream("tcp_pose", replace(tilted["tcp_pose"], data=pose))
    same, other = told(level), told(tilted)
    assert isinstance(same, BiasDrift)
    assert isinstance(other, BiasDrift)
    assert (other.std_per_min[:3] > same.std_per_min[:3]).all()


@pytest.mark.parametrize(
    ("samples", "until_s", "says"),
    [
        (20_000, 20.0, "does not end free of contact"),
        (20_000, 19.75, "does not end free of contact"),
        (2_000, 1.5, "too little to tell a drift"),
    ],
)
def test_what_cannot_be_told_is_said(recording, samples, until_s, says):
    episode = recording(samples=samples)
    t = int(episode["wrench_raw"].t[0])
    found = told(episode, [Event(t + 1_000_000_000, t + round(until_s * 1e9), "contact")])
    assert isinstance(found, NotAssessed)
    assert says in found.reason


def test_an_arm_that_moves_at_the_end_tells_no_drift(recording):
    episode = recording(samples=20_000)
    joints = episode["joint_states"].data.copy()
    joints[-100:, 9] = 0.1
    moved = episode.with_stream("joint_states", replace(episode["joint_states"], data=joints))
    found = told(moved)
    assert isinstance(found, NotAssessed)
    assert "no rest at the end: the joints move" in found.reason
