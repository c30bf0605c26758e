import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

from wrenchflow.config import from_mapping, to_mapping
from wrenchflow.episode import Event
from wrenchflow.errors import CalibrationError, ConfigError, OutputError, RecordingError, StreamError
from wrenchflow.force_filter import FilterConfig
from wrenchflow.manifest import read_manifest
from wrenchflow.process.config import ContactConfig, ProcessConfig
from wrenchflow.process.pipeline import process_episode, process_folder
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode
from wrenchflow.rig import rig_of

CONFIG = ProcessConfig()


def with_cutoff(cutoff_hz: float) -> ProcessConfig:
    return ProcessConfig(filter=FilterConfig(cutoff_hz=cutoff_hz))


def test_a_clean_episode_has_both_wrenches_its_contact_and_how_it_was_made(recording, true_bias):
    raw = recording()
    clean, quality = process_episode(raw, CONFIG)
    assert clean["wrench_raw"] == raw["wrench_raw"]
    assert clean["wrench"].frame == clean["wrench_zero_phase"].frame == "base"
    (contact,) = clean.events_of("contact")
    start_ns = int(raw["wrench_raw"].t[0])
    assert contact.start_ns == pytest.approx(start_ns + 1.0e9, abs=10e6)
    assert contact.stop_ns == pytest.approx(start_ns + 1.5e9, abs=10e6)
    notes = clean.meta["process"]
    assert from_mapping(ProcessConfig, notes["config"]) == CONFIG
    np.testing.assert_allclose(notes["bias"]["mean"], true_bias, atol=0.05)
    assert (notes["bias"]["start_ns"], notes["bias"]["samples"]) == (start_ns, 500)
    assert notes["group_delay_s"] == pytest.approx(0.0103, abs=1e-4)
    assert (notes["left_out_samples"], notes["gaps"]) == (0, 0)
    json.dumps(notes, allow_nan=False)
    assert quality.id == "0007"


def test_the_four_basic_metrics(recording):
    _, quality = process_episode(recording(push_n=(0.0, 3.0, -10.0)), CONFIG)
    # The causal filter overshoots a step by 11 %, and the noise comes on top.
    assert np.hypot(3, 10) < quality["max_force"] < 1.2 * np.hypot(3, 10)
    assert quality["has_contact"]
    assert quality["contacts"] == 1
    assert quality["contact_fraction"] == pytest.approx(0.25, abs=0.01)
    # By hand: 10 N over the noise that 40 Hz, there and back, leaves of 0.2 N.
    assert quality.snr["fz"] == pytest.approx(20 * np.log10(10 / (0.2 * np.sqrt(2 * 36 / 1000))), abs=2.0)
    assert quality.snr["fz"] > quality.snr["fy"] > quality.snr["fx"]
    # Up and down again is two steps of the norm over 2000 samples; noise comes on top.
    assert quality["smoothness"] > 2 * np.hypot(3, 10) / 2000
    assert quality.success is True
    assert quality["samples"] == 2000
    assert quality.is_sound


def test_without_contact_the_snr_is_not_assessed_and_says_why(recording):
    _, quality = process_episode(recording(push_n=(0.0, 0.0, 0.0)), CONFIG)
    assert not quality["has_contact"]
    assert set(quality.snr.values()) == {None}
    assert quality.why_not("snr_force_db") == "0 samples of contact, 100 needed"
    assert [finding.kind for finding in quality.findings] == ["no-contact"]


@pytest.mark.parametrize(("success", "severity"), [(True, "warning"), (False, "defect"), (None, "defect")])
def test_a_success_without_contact_is_a_warning(recording, success, severity):
    raw = recording(push_n=(0.0, 0.0, 0.0))
    result = {} if success is None else {"result": {"success": success}}
    meta = {key: value for key, value in raw.meta.items() if key != "result"} | result
    _, quality = process_episode(replace(raw, meta=meta), CONFIG)
    assert [(finding.kind, finding.severity) for finding in quality.findings] == [("no-contact", severity)]


def test_a_force_sensor_gives_force_streams_and_no_moments(recording):
    clean, quality = process_episode(recording(force_only=True), CONFIG)
    assert clean["wrench"].signal.kind == clean["wrench_zero_phase"].signal.kind == "force"
    assert clean["wrench"].data.shape == (2000, 3)
    assert set(quality.snr) == {"fx", "fy", "fz"}
    assert quality["snr_torque_db"] is None
    assert quality["snr_force_db"] is not None
    assert "no moments" in quality.why_not("snr_torque_db")
    assert len(quality.bias) == 3


def test_contacts_of_an_earlier_pass_are_replaced(recording):
    once, _ = process_episode(recording(), CONFIG)
    twice, _ = process_episode(once, CONFIG)
    assert twice == once


def test_a_refused_episode_is_named(recording):
    raw = recording()
    pressed = replace(raw["wrench_raw"], data=raw["wrench_raw"].data - [0, 0, 24.0, 0, 0, 0])
    with pytest.raises(CalibrationError, match=r"^episode 0007: the reading is loaded in the bias window"):
        process_episode(raw.with_stream("wrench_raw", pressed), CONFIG)
    without = {name: stream for name, stream in raw.streams.items() if name != "tcp_pose"}
    with pytest.raises(StreamError, match=r"'tcp_pose' is not in episode 0007. It has: joint_states, wrench_raw"):
        process_episode(replace(raw, streams=without), CONFIG)
    with pytest.raises(ConfigError, match=r"episode 0007: .* carries no rig"):
        process_episode(replace(raw, meta={}), CONFIG)
    with pytest.raises(StreamError, match=r"episode 0007: stream 'wrench_raw' has 0 samples"):
        process_episode(raw.with_stream("wrench_raw", raw["wrench_raw"].between(0, 1)), CONFIG)


def test_an_impossible_config_is_refused(recording):
    with pytest.raises(ConfigError, match=r"filter\.cutoff_hz is 0, expected more than 0"):
        FilterConfig(cutoff_hz=0.0)
    with pytest.raises(ConfigError, match="half of the 1000 Hz"):
        process_episode(recording(), with_cutoff(500.0))
    with pytest.raises(ConfigError, match="above the noise"):
        process_episode(recording(), ProcessConfig(contact=ContactConfig(on_n=1.0, off_n=0.1)))


# ---- twins of two real recordings: what is known of them is planted here


def test_screw_driving_is_refused_as_uneven_and_never_free_of_contact(recording):
    """About 47 Hz, with steps of 18 to 153 ms, pressing with 24 N from the first row to the last."""
    rng = np.random.default_rng(0)
    steps_ms = np.where(rng.random(726) < 0.25, rng.uniform(40, 153, 726), rng.uniform(18, 24, 726))
    raw = recording(samples=726)
    t = (np.cumsum(steps_ms) * 1e6).astype(np.int64)
    data = raw["wrench_raw"].data.copy()
    data[:, 2] -= 24.0
    rig = rig_of(raw.meta, "twin")
    at_47_hz = replace(rig, sensor=replace(rig.sensor, rate_hz=47.0))
    screw = (
        replace(raw, events=(), meta={"rig": to_mapping(at_47_hz)})
        .with_stream("wrench_raw", replace(raw["wrench_raw"], t=t, data=data))
        .with_stream("tcp_pose", replace(raw["tcp_pose"], t=t))
        .with_stream("joint_states", replace(raw["joint_states"], t=t))
    )
    with pytest.raises(StreamError, match=r"unevenly sampled: got steps of 18 to 15\d ms"):
        process_episode(screw, with_cutoff(10.0))
    even = (np.arange(726) / 47.0 * 1e9).astype(np.int64)
    made_even = screw.with_stream("wrench_raw", replace(screw["wrench_raw"], t=even))
    made_even = made_even.with_stream("tcp_pose", replace(screw["tcp_pose"], t=even))
    with pytest.raises(CalibrationError, match=r"loaded .* in fz"):
        process_episode(made_even, with_cutoff(10.0))


def test_hand_guiding_at_another_rate_than_the_rig_says_is_refused(recording):
    """A force sensor logged every 1.44 ms, though 1 kHz was assumed: a 40 Hz filter would cut at 28 Hz."""
    raw = recording(force_only=True)
    t = raw["wrench_raw"].t[0] + np.arange(2000) * 1_440_000
    with pytest.raises(StreamError, match=r"median 1\.44 ms \(mean rate 694\.\d Hz\).* expected 1 ms \(1000 Hz\)"):
        process_episode(raw.with_stream("wrench_raw", replace(raw["wrench_raw"], t=t)), CONFIG)


# ---- the folder


@pytest.fixture
def raw_folder(tmp_path: Path, recording) -> Path:
    raw = tmp_path / "raw"
    raw.mkdir()
    for i in range(3):
        write_episode(raw / f"{i:04}.mcap", recording(id=f"{i:04}", seed=i))
    return raw


def test_a_folder_becomes_clean_recordings_with_their_quality_and_report(raw_folder: Path, tmp_path: Path):
    out = tmp_path / "clean"
    qualities = list(process_folder(raw_folder, out, CONFIG))
    assert sorted(path.name for path in out.iterdir()) == [
        *(f"{i:04}.mcap" for i in range(3)),
        "episodes",
        "manifest.json",
        "quality.json",
        "quality.parquet",
        "report.html",
    ]
    expected, _ = process_episode(read_episode(raw_folder / "0001.mcap"), CONFIG)
    assert read_episode(out / "0001.mcap") == expected
    table = pd.read_parquet(out / "quality.parquet")
    assert table["id"].tolist() == ["0000", "0001", "0002"]
    assert table["max_force"].tolist() == [quality["max_force"] for quality in qualities]
    assert table["snr"][0]["fz"] == qualities[0].snr["fz"]
    page = (out / "report.html").read_text()
    assert all(f"episodes/{i:04}.html" in page for i in range(3))
    pages = sorted(path.name for path in (out / "episodes").iterdir())
    assert pages == ["0000.html", "0001.html", "0002.html", "plotly.min.js"]
    assert sorted(read_manifest(out)["inputs"]) == ["0000.mcap", "0001.mcap", "0002.mcap"]


def test_the_same_input_gives_the_same_bytes_on_any_number_of_workers(raw_folder: Path, tmp_path: Path):
    list(process_folder(raw_folder, tmp_path / "one", CONFIG))
    with ThreadPoolExecutor(2) as executor:
        list(process_folder(raw_folder, tmp_path / "two", CONFIG, executor=executor))
    one, two = tmp_path / "one", tmp_path / "two"
    for path in filter(Path.is_file, one.rglob("*")):
        assert path.read_bytes() == (two / path.relative_to(one)).read_bytes(), path.name


def test_what_cannot_be_cleaned_or_read_is_told_and_stops_nothing(raw_folder: Path, tmp_path: Path, recording):
    write_episode(raw_folder / "0008.mcap", replace(recording(id="0008"), meta={}))
    whole = (raw_folder / "0000.mcap").read_bytes()
    (raw_folder / "0009.mcap").write_bytes(whole[: len(whole) // 2])
    good, unclean, unread = list(process_folder(raw_folder, tmp_path / "clean", CONFIG))[-3:]
    assert good.is_sound
    assert "carries no rig" in unclean.refused
    assert {finding.kind for finding in unclean.findings} == {"no-clean-force"}
    assert unclean["samples"] == 2000
    assert "no rig" in unclean.why_not("max_force")
    assert [finding.kind for finding in unread.findings] == ["unreadable"]
    assert set(unread.values.values()) == {None}
    assert sorted(path.name for path in (tmp_path / "clean").glob("*.mcap")) == ["0000.mcap", "0001.mcap", "0002.mcap"]
    table = pd.read_parquet(tmp_path / "clean" / "quality.parquet")
    assert table["defects"].tolist() == [0, 0, 0, 1, 1]


def test_a_configuration_that_fits_nothing_leaves_nothing_that_looks_whole(raw_folder: Path, tmp_path: Path):
    with pytest.raises(ConfigError, match="half of the 1000 Hz"):
        list(process_folder(raw_folder, tmp_path / "clean", with_cutoff(600.0)))
    assert not (tmp_path / "clean").exists()


def test_every_column_of_the_table_says_what_it_is(raw_folder: Path, tmp_path: Path):
    list(process_folder(raw_folder, tmp_path / "clean", CONFIG))
    schema = pq.read_schema(tmp_path / "clean" / "quality.parquet")
    assert all(schema.field(name).metadata[b"meaning"] for name in schema.names)
    assert {"snr", "max_force", "smoothness", "has_contact"} <= set(schema.names)
    told = json.loads((tmp_path / "clean" / "quality.json").read_text())
    assert set(told["metrics"]) <= set(schema.names)
    for episode in told["episodes"]:
        unknown = {name for name, value in episode["values"].items() if value is None}
        assert unknown == {each["kind"] for each in episode["not_assessed"]} & set(episode["values"])


def test_places_that_cannot_be_read_or_written_are_refused(raw_folder: Path, tmp_path: Path):
    with pytest.raises(RecordingError, match="does not exist"):
        list(process_folder(tmp_path / "none", tmp_path / "clean", CONFIG))
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match=r"holds no \*\.mcap"):
        list(process_folder(tmp_path / "empty", tmp_path / "clean", CONFIG))
    (tmp_path / "taken").mkdir()
    (tmp_path / "taken" / "thesis.txt").touch()
    with pytest.raises(OutputError, match="is no folder that wrenchflow made"):
        list(process_folder(raw_folder, tmp_path / "taken", CONFIG))
    for out in (raw_folder, tmp_path):
        with pytest.raises(OutputError, match="would replace what is read"):
            list(process_folder(raw_folder, out, CONFIG, overwrite=True))
    assert len(list(raw_folder.glob("*.mcap"))) == 3


def test_the_bias_window_is_the_marked_one(recording):
    """The start is pressed on, but the phase `tare` comes later."""
    raw = recording()
    data = raw["wrench_raw"].data.copy()
    data[:400, 2] -= 24.0
    pressed = raw.with_stream("wrench_raw", replace(raw["wrench_raw"], data=data))
    start_ns = int(raw["wrench_raw"].t[0])
    tare = Event(start_ns + 500_000_000, start_ns + 900_000_000, "phase", "tare")
    clean, _ = process_episode(replace(pressed, events=(tare,)), CONFIG)
    assert clean.meta["process"]["bias"]["start_ns"] == tare.start_ns
    with pytest.raises(CalibrationError):
        process_episode(replace(pressed, events=()), CONFIG)
