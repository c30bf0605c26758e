"""Real time is virtual time with other stamps: the same seed gives the same bits, whoever paces the ticks."""

import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from wrenchflow.collect import folder as collecting
from wrenchflow.collect import realtime
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.demonstration import demonstration_of
from wrenchflow.collect.folder import collect_folder
from wrenchflow.collect.session import demonstrate
from wrenchflow.control.safeguards import MODES
from wrenchflow.errors import ControlError, OutputError
from wrenchflow.ledger import Ledger
from wrenchflow.recording.images import images_of
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.recover import recover
from wrenchflow.recording.validate import validate
from wrenchflow.sim.gl import find_gl
from wrenchflow.view.live import LiveView

CONFIG = CollectConfig(episodes=1, seed=3, tare_s=0.5, realtime=True)


@pytest.fixture(scope="module")
def virtual(unchecked):
    with unchecked():
        return demonstrate(0, CONFIG)


def test_what_is_recorded_while_it_happens_is_what_virtual_time_gives(tmp_path, wrenchflow, virtual):
    ran = wrenchflow("collect", tmp_path / "raw", "--episodes", 1, "--seed", 3, "--tare-s", 0.5, "--realtime", "--json")
    assert ran.result["successes"] == 1
    (path,) = (tmp_path / "raw").glob("*.mcap")
    episode = read_episode(path)
    assert validate(path).problems == ()
    assert episode.id == virtual.id
    assert set(episode.streams) == set(virtual.streams)
    offset_ns = int(episode["tcp_pose"].t[0] - virtual["tcp_pose"].t[0])
    assert abs(episode["tcp_pose"].t[0] - time.time_ns()) < 120e9  # It was now, not in 2020.
    for name, stream in virtual.streams.items():
        np.testing.assert_array_equal(episode[name].data, stream.data, err_msg=name)
        np.testing.assert_array_equal(episode[name].t - offset_ns, stream.t, err_msg=name)
    assert [event.moved(-offset_ns) for event in episode.events] == sorted(virtual.events)
    assert episode.meta["safety"] == virtual.meta["safety"]
    assert episode.meta["governor"] == virtual.meta["governor"]
    recorded = episode.meta["recorded"]
    assert recorded["control"]["rows"] == len(episode["tcp_pose"])
    assert all(source["dropped"] == 0 for source in recorded.values())
    assert wrenchflow("process", tmp_path / "raw", tmp_path / "clean", "--jobs", 1).code == 0


def test_when_the_writer_dies_the_arm_holds_and_the_episode_can_be_recovered(tmp_path, monkeypatch, unchecked, virtual):
    tracked = []
    begun = realtime.Beat.__init__

    def begin_and_kill(self, recorder, *rest):
        begun(self, recorder, *rest)
        threading.Timer(1.2, os.kill, (recorder.writer_pid, signal.SIGKILL)).start()

    follow = realtime.Attempt.follow

    def seen(self, ticks, *rest):
        rows = follow(self, ticks, *rest)
        tracked.append(rows["command_pose"].copy())
        return rows

    monkeypatch.setattr(realtime.Beat, "__init__", begin_and_kill)
    monkeypatch.setattr(realtime.Attempt, "follow", seen)
    with unchecked(), pytest.raises(OutputError, match="died"):
        realtime.demonstrate_in_real_time(0, replace(CONFIG), tmp_path)
    before, held = tracked[-2:]
    assert len(held) == 500
    assert (held[-300:] == held[-1]).all()  # Nobody asks any more, so it holds where it was,
    np.testing.assert_allclose(held[-1, :3], before[-1, :3], atol=1e-3)  # but for what it was about to do.
    (partial,) = tmp_path.glob("*.partial")
    recover(partial, tmp_path / "saved.mcap")
    pose = read_episode(tmp_path / "saved.mcap")["tcp_pose"]
    assert len(pose) > 500
    np.testing.assert_array_equal(pose.data, virtual["tcp_pose"].data[: len(pose)])


def test_what_the_safety_layer_did_is_there_after_the_control_process_is_killed(tmp_path, virtual):
    command = [sys.executable, "-m", "wrenchflow", "collect", "raw", "--episodes", "1", "--seed", "3"]
    running = subprocess.Popen([*command, "--tare-s", "0.5", "--realtime"], cwd=tmp_path, stderr=subprocess.PIPE)
    folder, stop_s = tmp_path / "raw.partial", time.monotonic() + 60.0
    while not any(path.stat().st_size > 100_000 for path in folder.glob("*.mcap.partial")):
        assert running.poll() is None
        assert time.monotonic() < stop_s
        time.sleep(0.01)
    running.kill()
    running.communicate()
    while not (left := list(folder.glob("*.mcap"))):  # The writer completes it.
        assert time.monotonic() < stop_s
        time.sleep(0.01)
    episode = read_episode(left[0])
    assert episode.meta["result"]["failure"] == "the control process died"
    assert len(episode["governor"]) == len(episode["request"]) == len(episode["tcp_pose"]) > 100
    for name in ("governor", "request"):
        part = virtual[name].data[: len(episode[name])]
        np.testing.assert_array_equal(episode[name].data, part)
    assert Ledger.of(episode) is not None  # Names of modes and safeguards were there from the start.


GO_ON = "wrenchflow collect raw --episodes 2 --seed 3 --tare-s 0.5 --realtime --resume"


@pytest.mark.parametrize(
    ("number", "code"),
    [
        pytest.param("SIGUSR1", 1, marks=pytest.mark.slow),
        ("SIGTERM", 143),
        pytest.param("SIGINT", 130, marks=pytest.mark.slow),
    ],
)
def test_an_emergency_stop_by_signal_brakes_the_arm_and_completes_the_recording(tmp_path, number, code):
    command = [sys.executable, "-m", "wrenchflow", "collect", "raw", "--episodes", "2", "--seed", "3"]
    running = subprocess.Popen(
        [*command, "--tare-s", "0.5", "--realtime"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell that runs tests in the background has them ignore Ctrl-C, and every command that they start with them.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        start_new_session=True,
    )
    folder, stop_s = tmp_path / "raw.partial", time.monotonic() + 60.0
    while not any(path.stat().st_size > 100_000 for path in folder.glob("*.mcap.partial")):
        assert running.poll() is None
        assert time.monotonic() < stop_s
        time.sleep(0.01)
    # A terminal, `timeout` or a service manager tells the whole group: who writes must not be the first to go.
    (os.kill if number == "SIGUSR1" else os.killpg)(running.pid, getattr(signal, number))
    stdout, stderr = running.communicate(timeout=60.0)
    assert (running.returncode, stdout) == (code, "")
    said = {1: "emergency stop by SIGUSR1: the arm was braked.", 143: "terminated.", 130: "interrupted."}[code]
    line, last = stderr.splitlines()
    assert line.startswith("discarded  ")
    assert last == f"wrenchflow: {said} 0 of 2 episodes are in '{folder}'. Go on with: {GO_ON}"
    (path,) = folder.rglob("*.mcap")
    assert path.parent.name == "discarded"
    assert validate(path).problems == ()
    episode = read_episode(path)
    assert episode.meta["result"]["failure"] == "stopped: emergency-stop"
    governor, moved = episode["governor"], np.abs(episode["joint_states"].data[:, 7:14]).max(1)
    latched = np.flatnonzero(governor.data[:, 0] == MODES.index("latched"))
    assert 500 <= len(latched) <= 1100  # Half a second, or what was left of the tare.
    assert latched[0] + len(latched) == len(governor)  # Once latched, to the end.
    assert moved[-1] < 0.01


def test_a_stop_during_the_start_up_checks_is_what_is_told(tmp_path, monkeypatch, unchecked):
    check_cell = collecting.check_cell

    def stopped(config, stop):
        signal.raise_signal(signal.SIGUSR1)
        return check_cell(config, stop)

    monkeypatch.setattr(collecting, "check_cell", stopped)
    with unchecked(), pytest.raises(ControlError, match="emergency stop by SIGUSR1"):
        list(collect_folder(tmp_path / "raw", CONFIG))
    assert not (tmp_path / "raw").exists()


def test_a_live_view_shows_what_is_recorded_and_changes_nothing_of_it(
    tmp_path, monkeypatch, unchecked, virtual, rerun_columns
):
    shown = tmp_path / "live.rrd"
    cameras = ("wrist",) if find_gl() else ()
    config = replace(CONFIG, live=True, realtime=False, cameras=cameras)

    def to_a_file(name, control, views, attempt):
        return LiveView(name, [control, realtime.DEVICE, realtime.GOAL], views=views, meta=attempt.meta, save=shown)

    monkeypatch.setattr(realtime, "_live", to_a_file)
    with unchecked():
        (done,) = collect_folder(tmp_path / "raw", config)
    episode = read_episode(tmp_path / "raw" / f"{done.id}.mcap")
    for name, stream in virtual.streams.items():
        np.testing.assert_array_equal(episode[name].data, stream.data, err_msg=name)
    columns = rerun_columns(shown, "time")
    t, position = columns["/tcp_pose/position", "Scalars:scalars"]
    pose = episode["tcp_pose"]
    np.testing.assert_array_equal(position, pose.data[np.searchsorted(pose.t, t), :3])
    assert 15 <= np.median(np.diff(t)) * 1e-6 <= 25
    if cameras:
        recorded = episode.messages["camera/wrist"]
        t, pictures = columns["/camera/wrist", "EncodedImage:blob"]
        data = {image.t_ns: bytes(image.data) for image in images_of(recorded)}
        assert len(t) > 3
        assert all(bytes(picture[0]) == data[stamp] for stamp, picture in zip(t.tolist(), pictures, strict=True))


def test_what_an_interrupted_run_recorded_is_not_done_away_with(tmp_path, monkeypatch, unchecked, virtual):
    done = demonstration_of(virtual)

    def interrupted(index, config, folder, stop, desk):
        if index == 1:
            raise KeyboardInterrupt
        (folder / "0000.mcap").write_text("a demonstration")
        return done

    monkeypatch.setattr(realtime, "demonstrate_in_real_time", interrupted)
    with unchecked():
        with pytest.raises(KeyboardInterrupt):
            list(collect_folder(tmp_path / "raw", replace(CONFIG, episodes=2)))
        kept = tmp_path / "raw.partial" / "0000.mcap"
        for config in (CONFIG, replace(CONFIG, realtime=False)):
            with pytest.raises(OutputError, match=r"raw\.partial' holds what an interrupted run recorded"):
                list(collect_folder(tmp_path / "raw", config))
        assert kept.read_text() == "a demonstration"
        list(collect_folder(tmp_path / "raw", CONFIG, overwrite=True))
    assert not kept.exists()
    assert sorted(entry.name for entry in (tmp_path / "raw").iterdir()) == ["0000.mcap", "manifest.json"]
