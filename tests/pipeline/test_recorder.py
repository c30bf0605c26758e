"""A recording in two processes: nothing is lost that could be kept, and the death of either one is survived."""

import os
import resource
import signal
import subprocess
import sys
import time
from multiprocessing.shared_memory import SharedMemory
from pathlib import Path

import numpy as np
import pytest

from wrenchflow.episode import Event
from wrenchflow.errors import ConfigError, OutputError, RecordingError, StreamError
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.recorder import Recorder
from wrenchflow.recording.recover import recover
from wrenchflow.recording.ring import Ring
from wrenchflow.recording.validate import validate
from wrenchflow.signals import FORCE, POSE, WRENCH
from wrenchflow.source import Column, Source

TICK_NS = 1_000_000
START_NS = 1_700_000_000_000_000_000
CONTROL_ROW = np.dtype([("t_ns", "i8"), ("sequence", "i8"), ("pose", "f8", (7,)), ("wrench", "f8", (6,))], align=True)
SENSOR_ROW = np.dtype([("t_ns", "i8"), ("received_ns", "i8"), ("force", "f8", (3,))], align=True)
CONTROL = Source(
    name="control",
    dtype=CONTROL_ROW,
    columns=(
        Column(name="pose", signal=POSE, frame="base"),
        Column(name="wrench", signal=WRENCH, frame="sensor", lag_ns=TICK_NS),
    ),
)
SENSOR = Source(name="sensor", dtype=SENSOR_ROW, columns=(Column(name="force", signal=FORCE, frame="sensor"),))


def sent(count: int) -> np.ndarray:
    """Rows of the control loop, the same every time."""
    rows, rng = np.zeros(count, CONTROL_ROW), np.random.default_rng(0)
    rows["t_ns"] = START_NS + np.arange(count) * TICK_NS
    rows["sequence"] = np.arange(count)
    rows["pose"], rows["wrench"] = rng.normal(size=(count, 7)), rng.normal(size=(count, 6))
    return rows


def store(recorder: Recorder, rows: np.ndarray, pace_s: float = 0.0002) -> None:
    for number in range(len(rows)):
        recorder.push("control", rows[number : number + 1])
        time.sleep(pace_s)


def record(path: Path, **options) -> Recorder:
    return Recorder(path, id="7", task="peg-insertion", sources=[CONTROL, SENSOR], meta={"seed": 7}, **options)


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_what_was_stored_is_what_is_read(tmp_path, compression):
    rows, path = sent(700), tmp_path / "e.mcap"
    force = np.zeros(1, SENSOR_ROW)
    with record(path, compression=compression) as recorder:
        store(recorder, rows[:350])
        for k in range(40):
            force["t_ns"], force["received_ns"] = START_NS + k * 7 * TICK_NS + 123, START_NS + k * 7 * TICK_NS + 300_000
            force["force"] = k
            recorder.push("sensor", force)
        recorder.event(Event(START_NS, START_NS + 5, "phase", "tare"))
        store(recorder, rows[350:])
        assert recorder.is_alive
        recorder.finish({"success": True})
    episode = read_episode(path)
    np.testing.assert_array_equal(episode["pose"].t, rows["t_ns"])
    np.testing.assert_array_equal(episode["pose"].data, rows["pose"])
    # A wrench is that of the tick before its row; the first row's has none.
    np.testing.assert_array_equal(episode["wrench"].t, rows["t_ns"][:-1])
    np.testing.assert_array_equal(episode["wrench"].data, rows["wrench"][1:])
    # A source with a clock of its own keeps its own stamps.
    np.testing.assert_array_equal(episode["force"].t, START_NS + np.arange(40) * 7 * TICK_NS + 123)
    assert episode.events == (Event(START_NS, START_NS + 5, "phase", "tare"),)
    assert episode.meta["result"] == {"success": True}
    assert episode.meta["recorded"]["control"] == {
        "rows": 700,
        "missing": 0,
        "gaps": 0,
        "longest_s": pytest.approx(1e-3),
        "jitter_s": 0.0,
        "dropped": 0,
    }
    assert validate(path).problems == ()
    assert [entry.name for entry in tmp_path.iterdir()] == ["e.mcap"]


def test_sample_and_receive_times_and_the_sources_own_numbers_are_kept(tmp_path):
    from mcap.reader import make_reader

    rows, path = sent(50), tmp_path / "e.mcap"
    rows["sequence"] *= 3
    with record(path) as recorder:
        store(recorder, rows)
        force = np.zeros(1, SENSOR_ROW)
        force["t_ns"], force["received_ns"] = START_NS, START_NS + 5_000
        recorder.push("sensor", force)
    with path.open("rb") as file:
        messages = list(make_reader(file).iter_messages())
    pose = [message.sequence for _, channel, message in messages if channel.topic == "/pose"]
    assert pose == list(range(0, 150, 3))
    (force_message,) = [message for _, channel, message in messages if channel.topic == "/force"]
    assert (force_message.publish_time, force_message.log_time) == (START_NS, START_NS + 5_000)


def test_a_gap_and_rows_that_found_no_room_are_counted(tmp_path):
    rows = sent(400)
    tight = Source(name="control", dtype=CONTROL_ROW, columns=CONTROL.columns, capacity=16)
    with Recorder(tmp_path / "e.mcap", id="7", task="t", sources=[tight]) as recorder:
        store(recorder, np.concatenate((rows[:100], rows[150:])), pace_s=0.0005)
        dropped = recorder.dropped
        assert dropped > 0
    said = read_episode(tmp_path / "e.mcap").meta["recorded"]["control"]
    assert said["dropped"] == dropped
    assert said["rows"] == 350 - dropped
    assert 50 <= said["missing"] <= 50 + dropped  # Nobody can count what is missing after the last row.
    assert said["gaps"] >= 1


def test_the_writers_death_is_noticed_and_the_file_is_recovered(tmp_path):
    rows, path = sent(2500), tmp_path / "e.mcap"
    recorder = record(path)
    store(recorder, rows[:1500], pace_s=0.001)
    os.kill(recorder.writer_pid, signal.SIGKILL)
    while recorder.is_alive:
        recorder.push("control", rows[1500:1501])
        time.sleep(0.001)
    store(recorder, rows[1501:1600])  # The loop goes on, whatever happens.
    with pytest.raises(OutputError, match=r"the writer of .*e\.mcap died.*wrenchflow recover"):
        recorder.finish({"success": True})
    recover(path.with_name("e.mcap.partial"), tmp_path / "saved.mcap")
    pose = read_episode(tmp_path / "saved.mcap")["pose"]
    assert len(pose) >= 1500 - 300
    np.testing.assert_array_equal(pose.data, rows["pose"][: len(pose)])


def _control(path: str) -> None:
    recorder = record(Path(path))
    store(recorder, sent(800), pace_s=0.001)
    os.kill(os.getpid(), signal.SIGKILL)


def test_the_control_processs_death_leaves_a_whole_file_that_says_so(tmp_path):
    path = tmp_path / "e.mcap"
    control = subprocess.run([sys.executable, __file__, str(path)], check=False)
    assert control.returncode == -signal.SIGKILL
    stop_s = time.monotonic() + 20.0
    while not path.exists():
        assert time.monotonic() < stop_s
        time.sleep(0.01)
    episode = read_episode(path)
    assert len(episode["pose"]) == 800
    np.testing.assert_array_equal(episode["pose"].data, sent(800)["pose"])
    assert episode.meta["result"] == {"success": False, "failure": "the control process died"}


def test_a_file_that_is_being_written_is_not_recovered(tmp_path):
    path, partial = tmp_path / "e.mcap", tmp_path / "e.mcap.partial"
    with record(path) as recorder:
        store(recorder, sent(300))
        with pytest.raises(RecordingError, match="is being written right now"):
            recover(partial, tmp_path / "saved.mcap")
        recorded = recorder.finish()
    assert recorded["control"]["rows"] == 300
    assert [entry.name for entry in tmp_path.iterdir()] == ["e.mcap"]


def test_where_a_ring_finds_no_room_the_others_are_given_back(tmp_path, monkeypatch):
    made, create = [], Ring.create

    def one_only(dtype, capacity):
        if made:
            raise OutputError("shared memory has no room.")
        made.append(create(dtype, capacity))
        return made[0]

    monkeypatch.setattr(Ring, "create", one_only)
    with pytest.raises(OutputError, match="no room"):
        record(tmp_path / "e.mcap")
    with pytest.raises(FileNotFoundError):
        SharedMemory(made[0].name)


def test_all_events_of_an_episode_may_be_told_at_once(tmp_path):
    events = tuple(Event(START_NS + k, START_NS + k + 1, "safety", f"hold: {k}") for k in range(3000))
    with record(tmp_path / "e.mcap") as recorder:
        store(recorder, sent(5))
        assert all(recorder.event(event) for event in events)
        recorder.finish({"success": True}, {"ticks": {"run": 5}})
    episode = read_episode(tmp_path / "e.mcap")
    assert episode.events == events
    assert episode.meta["safety"] == {"ticks": {"run": 5}}


def test_an_exception_in_the_loop_is_written_down(tmp_path):
    def loop() -> None:
        with record(tmp_path / "e.mcap") as recorder:
            store(recorder, sent(10))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        loop()
    assert read_episode(tmp_path / "e.mcap").meta["result"]["failure"] == "interrupted: ZeroDivisionError"


def test_a_full_disk_is_told_and_what_was_written_can_be_recovered(tmp_path):
    rows, path = sent(3000), tmp_path / "e.mcap"
    recorder = record(path)
    resource.prlimit(recorder.writer_pid, resource.RLIMIT_FSIZE, (200_000, 200_000))
    store(recorder, rows)
    with pytest.raises(OutputError, match="file too large"):
        recorder.finish({"success": True})
    recover(path.with_name("e.mcap.partial"), tmp_path / "saved.mcap")
    pose = read_episode(tmp_path / "saved.mcap")["pose"]
    assert len(pose) > 500
    np.testing.assert_array_equal(pose.data, rows["pose"][: len(pose)])


def test_what_cannot_be_begun_is_told_at_once(tmp_path):
    (tmp_path / "e.mcap").write_text("precious")
    with pytest.raises(OutputError, match="exists already"):
        record(tmp_path / "e.mcap")
    with pytest.raises(OutputError, match="no such file or directory"):
        record(tmp_path / "nowhere" / "e.mcap")
    with pytest.raises((ConfigError, OutputError), match="unknown compression 'zip'"):
        record(tmp_path / "f.mcap", compression="zip")
    with pytest.raises(StreamError, match="names of their own"):
        Recorder(tmp_path / "g.mcap", id="7", task="t", sources=[CONTROL, CONTROL])
    with pytest.raises(StreamError, match="has no field 'force'"):
        Source(name="control", dtype=CONTROL_ROW, columns=SENSOR.columns)
    with pytest.raises(StreamError, match="has 7 values, and a 'wrench' has 6"):
        Source(name="control", dtype=CONTROL_ROW, columns=(Column(name="pose", signal=WRENCH),))
    assert [entry.name for entry in tmp_path.iterdir()] == ["e.mcap"]


if __name__ == "__main__":
    _control(sys.argv[1])
