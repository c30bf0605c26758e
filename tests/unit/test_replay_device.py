"""A recording's reports as a device: the same counts at the same times, whoever asks, and rest at the end."""

import numpy as np
import pytest

from wrenchflow import signals
from wrenchflow.collect.devices.replay_device import Replay, open_replay
from wrenchflow.episode import Episode, Stream
from wrenchflow.errors import DeviceError, RecordingError
from wrenchflow.recording.write import write_episode

MS = 1_000_000
RECORDED_NS = 1_577_836_800_000_000_000


def joy(counts: np.ndarray, buttons: np.ndarray | None = None, every_ms: int = 5) -> Stream:
    data = np.zeros((len(counts), 8))
    data[:, :6] = counts
    if buttons is not None:
        data[:, 6:] = buttons
    t = RECORDED_NS + np.arange(len(counts), dtype=np.int64) * every_ms * MS
    return Stream(t, data, signals.JOY, "device")


def poses(t: np.ndarray) -> Stream:
    data = np.tile([0.5, 0.0, 0.3, 0.0, 1.0, 0.0, 0.0], (len(t), 1))
    data[:, 0] += (t - t[0]) * 1e-12
    return Stream(t, data, signals.POSE, "base")


@pytest.fixture
def reports() -> Stream:
    rng = np.random.default_rng(7)
    return joy(rng.integers(-350, 351, (40, 6)), rng.integers(0, 2, (40, 2)))


def test_what_was_recorded_is_read_back_period_by_period(reports):
    device = Replay(reports, full_scale_counts=350)
    for k in range(40):
        reading = device.read(10_000 + k * 5 * MS)
        assert reading.counts.tolist() == reports.data[k, :6].tolist()
        assert reading.buttons == reports.data[k, 6] + 2 * reports.data[k, 7]
        assert (reading.t_ns, reading.pose) == (10_000 + k * 5 * MS, None)


def test_a_slower_reader_gets_the_newest(reports):
    device = Replay(reports, full_scale_counts=350)
    device.read(0)
    reading = device.read(33 * MS)
    assert reading.counts.tolist() == reports.data[6, :6].tolist()
    assert reading.t_ns == 30 * MS


def test_it_is_over_a_period_after_its_last_report_and_rests(reports):
    device = Replay(reports, full_scale_counts=350)
    device.read(0)
    last = device.read(200 * MS - 1)
    assert (last.counts.any(), device.is_over) == (True, False)
    for at in (200 * MS, 10_000 * MS):
        reading = device.read(at)
        assert (reading.counts.any(), reading.buttons, reading.problem) == (False, 0, "")
        assert (reading.t_ns, device.is_over) == (last.t_ns, True)


def test_a_device_that_said_where_is_played_by_where_it_brought_the_target():
    reports = joy(np.zeros((20, 6)))
    targets = poses(RECORDED_NS + np.arange(120, dtype=np.int64) * MS)
    device = Replay(reports, full_scale_counts=1000, poses=targets)
    for k in range(20):
        reading = device.read(k * 5 * MS)
        assert reading.pose is not None
        # The target that a report asks for is reached when the next one comes.
        np.testing.assert_array_equal(reading.pose, targets.data[5 * (k + 1)])
    assert device.read(10**12).pose is None


@pytest.mark.parametrize(
    "meta", [{"device": {"full_scale_counts": 500}}, {"collect": {"twist_map": {"full_scale_counts": 500}}}]
)
def test_a_file_is_played_with_the_scale_that_it_tells(tmp_path, reports, meta):
    path = tmp_path / "a.mcap"
    write_episode(path, Episode("a", "peg", {"teleop/joy": reports, "target_pose": poses(reports.t)}, (), meta))
    device = open_replay(path)
    assert device.full_scale_counts == 500
    reading = device.read(0)
    assert (reading.counts.tolist(), reading.pose) == (reports.data[0, :6].tolist(), None)


def test_a_file_of_a_device_without_axes_is_played_by_its_targets(tmp_path):
    path, reports = tmp_path / "a.mcap", joy(np.zeros((20, 6)))
    targets = poses(RECORDED_NS + np.arange(120, dtype=np.int64) * MS)
    write_episode(path, Episode("a", "peg", {"teleop/joy": reports, "target_pose": targets}, (), {}))
    with pytest.raises(DeviceError, match="does not say the full scale"):
        open_replay(path)
    pose = open_replay(path, full_scale_counts=1000).read(0).pose
    assert pose is not None
    np.testing.assert_allclose(pose, targets.data[5], atol=1e-15)


def test_a_file_without_reports_says_what_it_has(tmp_path):
    path = tmp_path / "a.mcap"
    write_episode(path, Episode("a", "peg", {"target_pose": poses(np.arange(5, dtype=np.int64))}, (), {}))
    with pytest.raises(RecordingError, match=r"'teleop/joy' is not in .*target_pose"):
        open_replay(path)


def test_what_are_no_reports_is_refused():
    with pytest.raises(DeviceError, match="0 reports"):
        Replay(joy(np.zeros((0, 6))), full_scale_counts=350)
    with pytest.raises(DeviceError, match="finite"):
        Replay(joy(np.full((3, 6), np.nan)), full_scale_counts=350)
    with pytest.raises(DeviceError, match="full scale of 0"):
        Replay(joy(np.ones((3, 6))), full_scale_counts=0)
