"""The stage `export`, from recordings on disk to data sets on disk."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchflow.config import to_mapping
from wrenchflow.datasets import robomimic
from wrenchflow.datasets.config import ExportConfig
from wrenchflow.datasets.export import FORMATS, export_folder
from wrenchflow.datasets.load import load_steps
from wrenchflow.datasets.sample import STREAMS, to_steps
from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import ConfigError, DatasetError, OutputError, RecordingError
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode
from wrenchflow.signals import JOINTS, POSE, TWIST, WRENCH

START_NS = 1_700_000_000_000_000_000
SIGNALS = {"joint_states": JOINTS, "tcp_twist": TWIST, "wrench": WRENCH}


def recording(index: int, success: bool = True, task: str = "peg-insertion") -> Episode:
    rng = np.random.default_rng(index)
    streams = {}
    for name in STREAMS:
        signal, n = SIGNALS.get(name, POSE), 1 if name == "goal_pose" else 800
        data = rng.normal(size=(n, signal.width))
        if signal is POSE:
            data[:, 3:] /= np.linalg.norm(data[:, 3:], axis=1, keepdims=True)
        streams[name] = Stream(START_NS + np.arange(n, dtype=np.int64) * 1_000_000, data, signal, "base")
    tare = Event(START_NS, START_NS + 100_000_000, "phase", "tare")
    meta = {"result": {"success": success}, "process": {"group_delay_s": 0.0104}}
    return Episode(f"{index:04d}", task, streams, (tare,), meta)


def save(folder: Path, *episodes: Episode) -> None:
    folder.mkdir(exist_ok=True)
    for episode in episodes:
        write_episode(folder / f"{episode.id}.mcap", episode)


@pytest.fixture
def clean(tmp_path) -> Path:
    save(tmp_path / "clean", recording(0), recording(1, success=False), recording(2))
    return tmp_path / "clean"


def test_both_data_sets_live_in_one_folder_and_hold_the_steps_of_the_recordings(clean, tmp_path):
    out = tmp_path / "dataset"
    config = ExportConfig(rate_hz=25.0)
    for format in ("robomimic", "lerobot"):
        results = list(export_folder(format, clean, out, config))
        assert [(one.id, one.steps, one.left_out) for one in results] == [
            ("0000", 17, ""),
            ("0001", 0, "not a success"),
            ("0002", 17, ""),
        ]
    assert sorted(entry.name for entry in out.iterdir()) == [
        "lerobot",
        "lerobot.manifest.json",
        "robomimic.hdf5",
        "robomimic.manifest.json",
        "robomimic.train.json",
    ]
    expected = [to_steps(read_episode(clean / f"{id}.mcap"), 25) for id in ("0000", "0002")]
    for path in (out, out / "robomimic.hdf5", out / "lerobot"):
        for one, other in zip(load_steps(path), expected, strict=True):
            assert (one.episode_id, one.period_ns, one.success) == (other.episode_id, 40_000_000, True)
            np.testing.assert_array_equal(one.t, other.t)
            np.testing.assert_array_equal(one.actions, other.actions)
            for name, values in other.observations.items():
                np.testing.assert_array_equal(one.observations[name], values)
    manifest = json.loads((out / "robomimic.manifest.json").read_text())
    assert manifest["config"] == to_mapping(config)
    assert sorted(manifest["inputs"]) == ["0000.mcap", "0001.mcap", "0002.mcap"]
    about = json.loads((out / "lerobot" / "meta" / "wrenchflow.json").read_text())
    assert about["wrench_group_delay_s"] == 0.0104


def test_workers_and_a_second_run_change_no_byte(clean, tmp_path):
    for out, jobs in (("one", 1), ("two", 2)):
        list(export_folder("robomimic", clean, tmp_path / out, ExportConfig(only_success=False), jobs=jobs))
    for name in ("robomimic.hdf5", "robomimic.manifest.json"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    assert [one.success for one in load_steps(tmp_path / "one")] == [True, False, True]


def test_what_is_there_is_kept_unless_told(clean, tmp_path):
    out = tmp_path / "dataset"
    list(export_folder("robomimic", clean, out, ExportConfig()))
    before = (out / "robomimic.hdf5").read_bytes()
    with pytest.raises(OutputError, match=r"robomimic\.hdf5' exists already"):
        next(export_folder("robomimic", clean, out, ExportConfig(rate_hz=10.0)))
    assert (out / "robomimic.hdf5").read_bytes() == before
    list(export_folder("robomimic", clean, out, ExportConfig(rate_hz=10.0), overwrite=True))
    assert load_steps(out)[0].period_ns == 100_000_000


@pytest.mark.parametrize("format", list(FORMATS))
def test_an_export_that_is_interrupted_leaves_nothing_that_looks_whole(clean, tmp_path, format):
    out = tmp_path / "dataset"
    results = export_folder(format, clean, out, ExportConfig())
    next(results)
    results.close()
    assert not (out / FORMATS[format].name).exists()
    assert len(list(export_folder(format, clean, out, ExportConfig()))) == 3
    assert (out / FORMATS[format].name).exists()
    assert not list(out.glob("*.partial"))


def test_tasks_may_differ_and_are_told_apart(tmp_path):
    save(tmp_path / "clean", recording(0), recording(1, task="wiping"))
    list(export_folder("robomimic,lerobot", tmp_path / "clean", tmp_path / "dataset", ExportConfig()))
    for path in ("robomimic.hdf5", "lerobot"):
        assert [one.task for one in load_steps(tmp_path / "dataset" / path)] == ["peg-insertion", "wiping"]


def test_what_cannot_be_part_of_the_data_set_is_left_out_and_the_reason_told(tmp_path):
    short = replace(recording(1), events=(Event(START_NS, START_NS + 10**9, "phase", "tare"),))
    raw = recording(2)
    raw = replace(raw, streams={name: stream for name, stream in raw.streams.items() if name != "wrench"})
    lagging = replace(recording(3), meta={"result": {"success": True}, "process": {"group_delay_s": 0.1}})
    filtered = {"group_delay_s": 0.0104, "config": {"filter": {"cutoff_hz": 9.0}}}
    other = replace(recording(4), meta={"result": {"success": True}, "process": filtered})
    save(tmp_path / "clean", recording(0), short, raw, lagging, other, recording(6))
    (tmp_path / "clean" / "0005.mcap").write_bytes(b"nothing of the kind")
    out = tmp_path / "dataset"
    results = {one.id: one for one in export_folder("lerobot", tmp_path / "clean", out, ExportConfig())}
    reasons = {
        "0001": "expected a step of 0.05 s",
        "0002": "stream 'wrench' is not in",
        "0003": "lags 0.1 s, expected 0.0104 s",
        "0004": "a wrench through FilterConfig",
        "0005": "0005.mcap",
    }
    assert set(results) == {f"{i:04d}" for i in range(7)}
    for id, one in results.items():
        assert reasons.get(id, "") in one.left_out
        assert bool(one.left_out) == (id in reasons)
        assert (one.steps > 0) == (id not in reasons)
    assert [one.episode_id for one in load_steps(out)] == ["0000", "0006"]


def test_bad_input_is_said_in_one_line(clean, tmp_path):
    def export(format="robomimic", folder=clean, config=None):
        return list(export_folder(format, folder, tmp_path / "dataset", config or ExportConfig()))

    with pytest.raises(
        ConfigError, match=r"unknown format 'robomimik'\. Did you mean 'robomimic'\? Available: csv, lerobot"
    ):
        export("robomimik")
    with pytest.raises(RecordingError, match="does not exist"):
        export(folder=tmp_path / "nowhere")
    (tmp_path / "empty").mkdir()
    with pytest.raises(RecordingError, match=r"holds no \*\.mcap, got nothing"):
        export(folder=tmp_path / "empty")
    save(tmp_path / "failed", recording(5, success=False))
    with pytest.raises(DatasetError, match=r"no recording in .* can be exported; the first, 0005: not a success"):
        export(folder=tmp_path / "failed")
    with pytest.raises(DatasetError, match=r"0000: LeRobot takes a whole number of steps a second, got 25/2 Hz"):
        export("robomimic,lerobot", config=ExportConfig(rate_hz=12.5))
    with pytest.raises(ConfigError, match=r"no format is named\. Available: robomimic, lerobot"):
        export(",")
    with pytest.raises(ConfigError, match="rate_hz must be above 0 and 1000 at most, got 0"):
        ExportConfig(rate_hz=0.0)
    with pytest.raises(ConfigError, match="valid_fraction must be 0 or more and below 1, got 1"):
        ExportConfig(valid_fraction=1.0)
    assert not (tmp_path / "dataset").exists()


def test_a_write_that_fails_leaves_the_old_data_set(clean, tmp_path, monkeypatch):
    out = tmp_path / "dataset"
    list(export_folder("robomimic", clean, out, ExportConfig()))
    before = (out / "robomimic.hdf5").read_bytes()

    def full(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(robomimic, "to_keys", full)
    with pytest.raises(OutputError, match=r"cannot be written: .*No space left on device"):
        list(export_folder("robomimic", clean, out, ExportConfig(rate_hz=10.0), overwrite=True))
    assert (out / "robomimic.hdf5").read_bytes() == before
