from dataclasses import replace

import numpy as np
import pytest

from wrenchflow.calibration import SourceFile, calibrated, calibration_meta, load_calibration, toml_of
from wrenchflow.collect.calibrate import calibrate, simulated_truth
from wrenchflow.collect.calibration_motion import run_motion
from wrenchflow.config import to_mapping
from wrenchflow.episode import Event
from wrenchflow.errors import CalibrationError, ConfigError, OutputError, RecordingError, StreamError
from wrenchflow.process.calibrate_config import CalibrateConfig
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.csv_rests import COLUMNS
from wrenchflow.process.pipeline import process_episode
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode
from wrenchflow.rig import Payload, load_rig, rig_of

DATE = "2025-12-31"
TRUTH = Payload(mass_kg=0.6, com_sensor_m=(0.005, -0.01, 0.07))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A recorded motion, and the calibration from it."""
    folder = tmp_path_factory.mktemp("calibration")
    whole = run_motion(load_rig("panda_peg"), TRUTH, seed=5)
    needed = {name: whole[name] for name in ("wrench_raw", "tcp_pose", "joint_states")}
    write_episode(folder / "motion.mcap", replace(whole, streams=needed, attachments={}))
    found = calibrate(folder / "found.toml", [folder / "motion.mcap"], CalibrateConfig(), date=DATE)
    return folder, found


def write_csv(path, episode, *, every=1, names=COLUMNS):
    raw, pose = episode["wrench_raw"], episode["tcp_pose"]
    at = np.searchsorted(pose.t, raw.t, side="right") - 1
    table = np.column_stack([(raw.t - raw.t[0]) * 1e-9, raw.data, pose.data[at]])[::every]
    order = [COLUMNS.index(name) for name in names]
    np.savetxt(path, table[:, order], delimiter=",", header=",".join(names), comments="", fmt="%.9g")


def test_a_file_is_read_as_it_was_written(made, tmp_path):
    folder, found = made
    assert load_calibration(folder / "found.toml") == found
    odd = replace(found, sources=(SourceFile(file='a "b"\\\n\x7fä.mcap', sha256="0", rests=1),))
    (tmp_path / "odd.toml").write_text(toml_of(odd), encoding="utf-8")
    assert load_calibration(tmp_path / "odd.toml") == odd


def test_what_was_found_is_true_within_what_it_says(made):
    _, found = made
    assert abs(found.payload.mass_kg - TRUTH.mass_kg) < 4 * found.mass_std_kg
    assert found.date == DATE
    assert [source.rests for source in found.sources] == [6]
    std = np.sqrt(np.diag(found.covariance))
    assert std[0] == pytest.approx(found.mass_std_kg)
    np.testing.assert_allclose(std[4:], found.bias_std)
    assert found.left_n < found.limits["max_left_n"]
    assert found.condition < found.limits["max_condition"]


def test_a_rig_takes_the_payload_of_its_own_sensor_only(made):
    _, found = made
    rig = load_rig("panda_peg")
    assert calibrated(rig, found) == replace(rig, payload=found.payload)
    with pytest.raises(CalibrationError, match=r"another sensor: got 'wrist-6d', expected the rig's 'other'"):
        calibrated(replace(rig, sensor=replace(rig.sensor, name="other")), found)
    turned = replace(rig.sensor, T_flange_sensor=(0.0, 0.0, 0.03, 0.0, 0.0, 0.0, 1.0))
    with pytest.raises(CalibrationError, match="mounted otherwise"):
        calibrated(replace(rig, sensor=turned), found)


def test_a_verdict_that_a_person_changed_is_refused(made, tmp_path):
    text = (made[0] / "found.toml").read_text().replace('verdict = "accepted"', 'verdict = "refused"')
    (tmp_path / "changed.toml").write_text(text)
    with pytest.raises(ConfigError, match="verdict 'refused' cannot be used"):
        load_calibration(tmp_path / "changed.toml")


def test_processing_with_the_calibration_makes_right_what_a_wrong_payload_spoils(made):
    folder, found = made
    episode = read_episode(folder / "motion.mcap")
    wrong, _ = process_episode(episode, ProcessConfig())
    right, _ = process_episode(episode, ProcessConfig(calibration=folder / "found.toml"))
    rests = [event for event in episode.events if event.label.startswith("rest")]

    def left_n(clean):
        parts = [clean["wrench"].between(rest.start_ns, rest.stop_ns).data[:, :3].mean(axis=0) for rest in rests]
        return float(np.linalg.norm(parts, axis=1).max())

    assert left_n(wrong) > 0.5
    assert left_n(right) < 0.06
    assert rig_of(right.meta, "").payload == found.payload
    kept = right.meta["calibration"]
    assert kept["file"] == "found.toml"
    assert kept["payload"] == to_mapping(found.payload)
    assert "calibration" not in wrong.meta
    assert calibration_meta(None) == {}


def test_csv_tells_the_same_as_the_recording_in_any_order_of_columns(made, tmp_path):
    folder, found = made
    episode = read_episode(folder / "motion.mcap")
    write_csv(tmp_path / "a.csv", episode, names=tuple(reversed(COLUMNS)))
    config = CalibrateConfig(rig="panda_peg")
    told = calibrate(tmp_path / "a.toml", [tmp_path / "a.csv"], config, date=DATE)
    assert told.payload.mass_kg == pytest.approx(found.payload.mass_kg, abs=3 * found.mass_std_kg)
    np.testing.assert_allclose(told.payload.com_sensor_m, found.payload.com_sensor_m, atol=3 * max(found.com_std_m))


@pytest.mark.parametrize(
    ("change", "error", "says"),
    [
        (lambda text: text.replace("fx", "f_x", 1), RecordingError, r"unknown column 'fx'.*Expected: t, fx, fy"),
        (lambda text: text.replace("fy", "fx", 1), RecordingError, r"column 'fx' is there 2 times"),
        (
            lambda text: text.replace("\n0.001,", "\nsoon,", 1),
            RecordingError,
            r"line 3: t is 'soon', expected",
        ),
        (lambda text: text.replace("\n0,", "\n1.7e12,", 1), RecordingError, r"'t' holds values that are no seconds"),
        (lambda text: text.replace("\n0,", "\n1,", 1), StreamError, r"stamps must strictly increase"),
        (lambda text: "", RecordingError, r"unknown column 't'"),
        (lambda text: text[: text.index("\n") + 1], CalibrationError, r"never rests"),
        (lambda text: "\n".join(text.split("\n")[:3]), CalibrationError, r"never rests"),
    ],
)
def test_a_csv_that_is_none_is_told_of(made, tmp_path, change, error, says):
    write_csv(tmp_path / "good.csv", read_episode(made[0] / "motion.mcap"), every=1)
    lines = (tmp_path / "good.csv").read_text().split("\n")[:2000]
    (tmp_path / "bad.csv").write_text(change("\n".join(lines)))
    with pytest.raises(error, match=says):
        calibrate(tmp_path / "a.toml", [tmp_path / "bad.csv"], CalibrateConfig(rig="panda_peg"), date=DATE)
    assert not (tmp_path / "a.toml").exists()


def test_outputs_that_are_there_stay(made, tmp_path):
    folder, _ = made
    source, out = folder / "motion.mcap", tmp_path / "a.toml"

    def run(out=out, recordings=(source,), **options):
        return calibrate(out, recordings, CalibrateConfig(), date=DATE, **options)

    run()
    with pytest.raises(OutputError, match="exists already"):
        run()
    run(overwrite=True)
    (tmp_path / "rig.toml").write_text('robot = "panda"\n')
    with pytest.raises(OutputError, match="is no calibration of ours, and stays"):
        run(tmp_path / "rig.toml", overwrite=True)
    with pytest.raises(OutputError, match=r"is a \.toml file"):
        run(tmp_path / "a.txt")
    (tmp_path / "c.mcap").write_text("somebody's")
    for overwrite in (False, True):
        with pytest.raises(OutputError, match=r"c\.mcap' exists already"):
            run(tmp_path / "c.toml", recordings=(), overwrite=overwrite)
    with pytest.raises(CalibrationError, match="given twice"):
        run(tmp_path / "b.toml", (source, source))


def test_recordings_without_a_rig_or_of_two_sensors_are_refused(made, tmp_path):
    episode = read_episode(made[0] / "motion.mcap")
    write_episode(tmp_path / "bare.mcap", replace(episode, meta={}))
    with pytest.raises(ConfigError, match="carries no rig"):
        calibrate(tmp_path / "a.toml", [tmp_path / "bare.mcap"], CalibrateConfig(), date=DATE)
    rig = load_rig("panda_peg")
    other = to_mapping(replace(rig, sensor=replace(rig.sensor, name="other")))
    write_episode(tmp_path / "other.mcap", episode.with_meta(rig=other))
    with pytest.raises(CalibrationError, match="of another sensor or mount than"):
        calibrate(tmp_path / "a.toml", [made[0] / "motion.mcap", tmp_path / "other.mcap"], CalibrateConfig(), date=DATE)


def test_a_simulated_truth_is_drawn_apart_from_the_rig_or_given():
    rig = load_rig("panda_peg")
    drawn = simulated_truth(CalibrateConfig(seed=3))
    assert drawn != rig.payload
    assert drawn == simulated_truth(CalibrateConfig(seed=3))
    given = simulated_truth(CalibrateConfig(seed=3, true_mass_kg=1.5, true_com_sensor_m=(0.0, 0.01, 0.02)))
    assert given == Payload(mass_kg=1.5, com_sensor_m=(0.0, 0.01, 0.02))


def test_a_refused_calibration_leaves_no_file(made, tmp_path):
    episode = read_episode(made[0] / "motion.mcap")
    first = [event for event in episode.events if not event.label.startswith("rest")]
    some = [Event(e.start_ns, e.stop_ns, e.kind, e.label) for e in episode.events if e.label in ("rest 1", "rest 2")]
    write_episode(tmp_path / "few.mcap", replace(episode, events=(*first, *some)))
    with pytest.raises(CalibrationError, match="4 orientations at least, got 2 rests"):
        calibrate(tmp_path / "a.toml", [tmp_path / "few.mcap"], CalibrateConfig(), date=DATE)
    assert not list(tmp_path.glob("a.toml*"))
