"""The last ten seconds of an attempt are there whatever ended it, and hold what the attempt did, bit for bit."""

import os
import resource
import signal
import subprocess
import sys
import time
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchflow.collect import session
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.demonstration import id_of
from wrenchflow.collect.folder import collect_folder
from wrenchflow.collect.session import demonstrate
from wrenchflow.deploy.config import DeployConfig
from wrenchflow.deploy.run import deploy_folder
from wrenchflow.errors import ControlError, OutputError, RecordingError
from wrenchflow.recording.black_box import BlackBox, black_boxes
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.recover import recover
from wrenchflow.recording.row_file import make_row_file, read_row_file
from wrenchflow.recording.validate import validate
from wrenchflow.sim.attempt import episode_id
from wrenchflow.sim.streams import ROWS

COMMAND = str(Path(sys.executable).with_name("wrenchflow"))
PATIENCE_S = 120.0
# A long rest, so that there is more than a black box keeps, and time to kill somebody.
CONFIG = CollectConfig(episodes=1, seed=3, tare_s=12.0)
NAME = id_of(CONFIG, 0)


@pytest.fixture(scope="module")
def whole(unchecked):
    """What would have been recorded."""
    with unchecked():
        return demonstrate(0, CONFIG)


def fail_in(monkeypatch, owner, name, error, after: int) -> None:
    """Let a method raise when it is called for the `after`-th time."""
    plain, calls = getattr(owner, name), []

    def failing(self, *arguments):
        calls.append(1)
        if len(calls) == after:
            raise error
        return plain(self, *arguments)

    monkeypatch.setattr(owner, name, failing)


def agrees(box, whole, most: int = 10_001) -> None:
    """Every stream of a black box is a part of the attempt's, and it lasts as long as it can."""
    assert set(box.streams) == set(whole.streams)
    for name, stream in box.streams.items():
        part = whole[name].between(int(stream.t[0]), int(stream.t[-1]) + 1)
        assert part == stream, name
    assert most - 2 <= len(box["governor"]) <= most
    assert box["governor"].t[0] > whole["governor"].t[0]


def the_only(folder: Path) -> Path:
    (path,) = folder.iterdir()
    return path


@pytest.mark.parametrize("error", [ZeroDivisionError("by hand"), KeyboardInterrupt()])
def test_an_operator_that_raises(tmp_path, monkeypatch, unchecked, whole, error):
    from wrenchflow.collect.scripted import Scripted

    fail_in(monkeypatch, Scripted, "want", error, after=300)
    with unchecked(), pytest.raises(type(error)) as raised:
        list(collect_folder(tmp_path / "raw", CONFIG))
    path = the_only(tmp_path / "raw.blackbox")
    assert raised.value.__notes__ == [f"The black box is '{path}'."]
    assert path.name == f"{NAME}.blackbox.mcap"
    assert validate(path).problems == ()
    box = read_episode(path)
    agrees(box, whole)
    assert len(box["teleop/joy"]) == 299
    why = f"{type(error).__name__}: {error}".removesuffix(": ")
    assert box.meta["result"] == {"success": False, "failure": why}
    assert box.events[-1].label == why
    assert box.events_of("success") == ()
    assert [event.label for event in box.events_of("phase")][:2] == ["tare", "approach"]
    for key in ("rig", "seed", "simulator", "collect", "operator", "governor"):
        assert box.meta[key] == whole.meta[key]
    assert set(box.meta["safety"]) == set(whole.meta["safety"])
    assert set(box.attachments) == set(whole.attachments)


def test_a_simulation_that_becomes_unstable_says_where_its_black_box_is(tmp_path, monkeypatch, wrenchflow, whole):
    period, calls = session.Session.period, []

    def shaken(self):
        calls.append(1)
        if len(calls) == 200:
            self._attempt.plant.data.qvel[3] = np.nan
        period(self)

    monkeypatch.setattr(session.Session, "period", shaken)
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its log where it runs.
    said = wrenchflow("collect", "raw", "--episodes", 1, "--seed", 3, "--tare-s", 12, "--jobs", 1)
    assert (said.code, said.stdout) == (1, "")
    why = "the simulation became unstable (mjWARN_BADQVEL) after 13001 ms."
    assert said.stderr == f"wrenchflow: {why} The black box is 'raw.blackbox/{NAME}.blackbox.mcap'.\n"
    box = read_episode(tmp_path / "raw.blackbox" / f"{NAME}.blackbox.mcap")
    assert box.meta["result"]["failure"] == f"ControlError: {why}"
    before = {name: stream.between(0, int(whole["tcp_pose"].t[12_990])) for name, stream in box.streams.items()}
    agrees(replace(box, streams=before), whole, most=9_990)
    assert len(box["tcp_pose"]) >= 10_000
    step_rad = np.abs(np.diff(box["joint_states"].data[:, :7], axis=0)).max(axis=1)
    assert step_rad[:-10].max() < 0.01 < step_rad[-10:].max()  # What happened is in there too.


def test_what_fails_before_anybody_acts_is_kept_too(tmp_path, monkeypatch, unchecked):
    fail_in(monkeypatch, session.Attempt, "samples_since", ControlError("no"), after=1)
    monkeypatch.setattr(session.Session, "streams", lambda self: 1 / 0)
    with unchecked(), pytest.raises(ControlError) as raised:
        list(collect_folder(tmp_path / "raw", CONFIG))
    assert raised.value.__notes__[0] == f"The black box of {NAME} has nothing but rows: division by zero"
    box = read_episode(the_only(tmp_path / "raw.blackbox"))
    assert set(box.streams) == {column.name for column in ROWS.columns}
    assert box.meta["operator"] == "scripted"


def test_a_policy_that_raises_leaves_a_black_box_of_each_attempt_that_it_was_at(
    tmp_path, monkeypatch, unchecked, chain
):
    from wrenchflow.policy.learned import LearnedPolicy

    fail_in(monkeypatch, LearnedPolicy, "act", ZeroDivisionError("by the policy"), after=3)
    out = tmp_path / "rollouts"
    with unchecked(), pytest.raises(ZeroDivisionError) as raised:
        list(deploy_folder(chain.folder / "run", out, DeployConfig(episodes=3, batch=2, seed=5)))
    assert raised.value.__notes__ == [f"The black boxes of 2 attempts are in '{tmp_path / 'rollouts.blackbox'}'."]
    boxes = [read_episode(path) for path in sorted((tmp_path / "rollouts.blackbox").iterdir())]
    assert [box.id for box in boxes] == [episode_id("rollout-peg-insertion", 5, index) for index in range(2)]
    for box in boxes:
        assert box.meta["result"] == {"success": False, "failure": "ZeroDivisionError: by the policy"}
        assert box.meta["deploy"]["seed"] == 5
        assert box.meta["plans"]["received"] == 2
        assert box["governor"].column("mode")[-1] == 0.0
        assert {column.name for column in ROWS.columns} <= set(box.streams)
    assert list((tmp_path / "rollouts.partial").iterdir()) == []


def test_an_attempt_that_ends_well_leaves_nothing(tmp_path, unchecked):
    with unchecked():
        list(collect_folder(tmp_path / "raw", replace(CONFIG, tare_s=0.5)))
    assert [path.name for path in tmp_path.iterdir()] == ["raw"]


def test_a_black_box_takes_the_place_of_no_other(tmp_path, monkeypatch, unchecked):
    for number in range(3):
        with monkeypatch.context() as patch:
            fail_in(patch, session.Session, "period", ControlError(f"time {number}"), after=2)
            with unchecked(), pytest.raises(ControlError):
                list(collect_folder(tmp_path / "raw", replace(CONFIG, tare_s=0.5)))
    boxes = [f"{NAME}{suffix}.blackbox.mcap" for suffix in ("", "-2", "-3")]
    failures = [read_episode(tmp_path / "raw.blackbox" / name).meta["result"]["failure"] for name in boxes]
    assert failures == [f"ControlError: time {number}" for number in range(3)]


@pytest.fixture
def killed(tmp_path):
    """Run `collect` until an attempt has rows, then end it with a signal; gives what it said, and the signal's name."""

    def run(number: signal.Signals, *, jobs: int = 1, whom: str = "parent") -> subprocess.CompletedProcess[str]:
        command = [COMMAND, "collect", "raw", "--episodes", "4", "--seed", "3", "--tare-s", "60", "--jobs", str(jobs)]
        running = subprocess.Popen(
            command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        try:
            rows, stop_s = tmp_path / "raw.blackbox" / f"{NAME}.rows", time.monotonic() + PATIENCE_S
            while not (rows.exists() and has_ticks(rows)):
                assert running.poll() is None, running.communicate()
                assert time.monotonic() < stop_s
                time.sleep(0.01)
            os.kill(running.pid if whom == "parent" else worker_of(running.pid, rows), number)
            stdout, stderr = running.communicate(timeout=PATIENCE_S)
        finally:
            if running.poll() is None:
                os.killpg(running.pid, signal.SIGKILL)
        return subprocess.CompletedProcess(command, running.returncode, stdout, stderr)

    return run


def has_ticks(path: Path) -> bool:
    try:
        return len(read_row_file(path).streams.get("governor", ())) > 100
    except RecordingError:
        return False


def worker_of(parent: int, rows: Path) -> int:
    """The worker process that has a file of rows mapped."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text().split()
    return next(int(child) for child in children if str(rows) in Path(f"/proc/{child}/maps").read_text())


@pytest.fixture(scope="module")
def whole_minute(unchecked):
    with unchecked():
        return demonstrate(0, replace(CONFIG, tare_s=60.0))


def is_part_of(box, whole, most: int) -> None:
    for name, stream in box.streams.items():
        assert whole[name].between(int(stream.t[0]), int(stream.t[-1]) + 1) == stream, name
    assert 99 < len(box["governor"]) <= most


@pytest.mark.parametrize(
    ("number", "code", "word"), [(signal.SIGTERM, 143, "terminated"), (signal.SIGINT, 130, "interrupted")]
)
def test_a_signal_that_asks_writes_it_and_says_so(tmp_path, killed, whole_minute, number, code, word):
    ran = killed(number)
    path = tmp_path / "raw.blackbox" / f"{NAME}.blackbox.mcap"
    assert (ran.returncode, ran.stdout) == (code, "")
    on = "wrenchflow collect raw --episodes 4 --seed 3 --tare-s 60 --jobs 1 --resume"
    assert ran.stderr == f"wrenchflow: {word}. The black box is 'raw.blackbox/{path.name}'. Go on with: {on}\n"
    box = read_episode(path)
    is_part_of(box, whole_minute, 10_001)
    assert box.meta["result"]["failure"] == {143: "Terminated", 130: "KeyboardInterrupt"}[code]


def test_after_kill_the_rows_are_there_and_recover_reads_them(tmp_path, killed, wrenchflow, whole_minute):
    assert killed(signal.SIGKILL).returncode == -signal.SIGKILL
    rows = tmp_path / "raw.blackbox" / f"{NAME}.rows"
    said = wrenchflow("info", rows)
    assert said.code == 1
    assert f"`wrenchflow recover {rows}` saves what it holds" in said.stderr
    recovered = wrenchflow("recover", rows, "--json").result
    assert recovered["out"] == str(rows.with_name(f"{NAME}.recovered.mcap"))
    episode = read_episode(Path(recovered["out"]))
    is_part_of(episode, whole_minute, 61_000)
    assert episode["governor"].t[0] == whole_minute["governor"].t[0]  # Not the end alone: all there is.
    assert validate(Path(recovered["out"])).problems == ()


def test_after_kill_the_next_run_makes_a_black_box_of_the_rows(tmp_path, killed, unchecked, whole_minute):
    assert killed(signal.SIGKILL).returncode == -signal.SIGKILL
    with unchecked():
        list(collect_folder(tmp_path / "raw", replace(CONFIG, tare_s=0.5)))
    path = the_only(tmp_path / "raw.blackbox")
    box = read_episode(path)
    is_part_of(box, whole_minute, 10_001)
    assert box.meta["result"]["failure"] == "the process that ran it died"
    assert box.meta["seed"] == [3, 0, 0]


def test_the_rows_of_a_worker_that_is_killed_are_saved_by_who_started_it(tmp_path, killed, whole_minute):
    ran = killed(signal.SIGKILL, jobs=2, whom="worker")
    assert ran.returncode == 1
    boxes = sorted((tmp_path / "raw.blackbox").iterdir())
    assert f"{NAME}.blackbox.mcap" in [path.name for path in boxes]
    assert all(path.name.endswith(".blackbox.mcap") for path in boxes)
    assert "black box" in ran.stderr.splitlines()[-1]
    is_part_of(read_episode(tmp_path / "raw.blackbox" / f"{NAME}.blackbox.mcap"), whole_minute, 10_001)


def test_rows_that_somebody_fills_are_left_alone(tmp_path):
    folder = tmp_path / "raw.blackbox"
    folder.mkdir()
    path = folder / "e.rows"
    rows = make_row_file(path, ROWS, 10, id="e", task="t", meta={})
    with pytest.raises(RecordingError, match="is being written right now"):
        recover(path, tmp_path / "e.mcap")
    with black_boxes(tmp_path / "raw"):
        pass
    assert path.exists()
    del rows
    with black_boxes(tmp_path / "raw"):
        assert not path.exists()


def test_a_last_row_that_may_be_half_is_left_out_and_no_rows_are_no_recording(tmp_path):
    for stored, kept in ((0, None), (1, None), (2, 1), (7, 6), (10, 9)):
        path = tmp_path / f"{stored}.rows"
        rows = make_row_file(path, ROWS, 10, id="e", task="t", meta={"seed": 1})
        rows["t_ns"][:stored] = 1 + np.arange(stored) * 1_000_000
        rows["joint_command"][:stored] = np.arange(stored)[:, None]
        del rows
        if kept is None:
            with pytest.raises(RecordingError, match="holds no row that is whole"):
                recover(path, tmp_path / "out.mcap")
            continue
        recover(path, tmp_path / f"{stored}.mcap")
        episode = read_episode(tmp_path / f"{stored}.mcap")
        assert episode["joint_command"].data[:, 0].tolist() == list(range(kept))
        assert episode.meta["seed"] == 1


@pytest.mark.parametrize("damage", ["", "WRENCHROWS1\n", "WRENCHROWS1\n\x05\0\0\0\0\0\0\0{{{{{", "something else"])
def test_what_is_no_file_of_rows_is_told_and_stays(tmp_path, damage):
    folder = tmp_path / "raw.blackbox"
    folder.mkdir()
    (folder / "e.rows").write_text(damage)
    with pytest.raises(RecordingError, match=r"e\.rows is (not|a damaged) "):
        read_row_file(folder / "e.rows")
    with pytest.raises(ControlError) as raised, black_boxes(tmp_path / "raw"):
        raise ControlError("no")
    assert (folder / "e.rows").read_text() == damage
    assert raised.value.__notes__ == [
        f"Rows of 1 more are in '{folder}': `wrenchflow recover {folder / 'e.rows'}`, for one."
    ]


@pytest.mark.parametrize("is_there", [False, True])
def test_ctrl_c_while_the_rows_are_made_leaves_nothing(tmp_path, monkeypatch, is_there):
    move = os.replace

    def interrupted(*paths: Path) -> None:
        if is_there:
            move(*paths)
        raise KeyboardInterrupt

    monkeypatch.setattr("wrenchflow.recording.row_file.os.replace", interrupted)
    with (
        pytest.raises(KeyboardInterrupt) as raised,
        black_boxes(tmp_path / "raw") as boxes,
        BlackBox(boxes, ROWS, id="e", task="t", meta={}) as box,
    ):
        box.rows({}, 10)
    assert not getattr(raised.value, "__notes__", [])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("end", "why"),
    [
        (KeyboardInterrupt(), "the stage that it was part of ended: KeyboardInterrupt"),
        (OutputError("no room."), "the stage that it was part of ended: OutputError: no room."),
        (BrokenProcessPool("somebody died"), "the process that ran it died"),
    ],
)
def test_rows_that_a_worker_left_say_why_it_ended(tmp_path, caplog, end, why):
    def work() -> None:
        with black_boxes(tmp_path / "raw") as boxes:
            boxes.mkdir()
            make_row_file(boxes / "e.rows", ROWS, 10, id="e", task="t", meta={})["t_ns"][:5] = 1 + np.arange(5)
            raise end

    with pytest.raises(type(end)):
        work()
    box = the_only(tmp_path / "raw.blackbox")
    assert read_episode(box).meta["result"]["failure"] == why
    assert not caplog.messages
    with black_boxes(tmp_path / "raw"):
        pass
    assert caplog.messages == [
        f"'{box.parent}' holds 1 of earlier runs' black boxes; it is not needed for anything else."
    ]


def test_rows_whose_room_was_not_made_yet_are_nothing(tmp_path):
    folder = tmp_path / "raw.blackbox"
    folder.mkdir()
    (folder / "e.rows.partial").write_bytes(bytes(5000))
    with black_boxes(tmp_path / "raw"):
        assert not folder.exists() or list(folder.iterdir()) == []
    assert list(tmp_path.iterdir()) == []


def test_where_there_is_no_room_for_rows_nothing_begins(tmp_path):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    heard = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, before[1]))
    try:
        with pytest.raises(OutputError, match=r"e\.rows cannot be made, with room for \d+ bytes: file too large\."):
            make_row_file(tmp_path / "e.rows", ROWS, 10_000, id="e", task="t", meta={})
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, heard)
    assert list(tmp_path.iterdir()) == []


def test_a_black_box_that_cannot_be_written_hides_nothing(tmp_path, monkeypatch):
    def full(*_):
        raise OutputError("no space left.")

    monkeypatch.setattr("wrenchflow.recording.black_box.write_episode", full)

    def attempt() -> None:
        with BlackBox(tmp_path, ROWS, id="e", task="t", meta={}) as box:
            box.rows({}, 10)["t_ns"][:5] = 1 + np.arange(5)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError) as raised:
        attempt()
    assert raised.value.__notes__ == ["The black box of e could not be written: no space left."]
    assert (tmp_path / "e.rows").exists()
