"""Somebody demonstrates: keys keep, discard and stop; marks and lost devices are in the recording; nothing is lost."""

import itertools
import signal
from dataclasses import replace

import numpy as np
import pytest

from hands.wire import Wire
from wrenchflow.clock import Clock
from wrenchflow.collect import realtime, sitting
from wrenchflow.collect.board.board import Nowhere
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.device_config import DeviceConfig
from wrenchflow.collect.devices import spacemouse
from wrenchflow.collect.devices.device import Reading
from wrenchflow.collect.folder import collect_folder
from wrenchflow.collect.wishes import GRACE_S
from wrenchflow.episode import Episode, Stream
from wrenchflow.errors import ControlError, DeviceError, OutputError
from wrenchflow.manifest import read_manifest
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode
from wrenchflow.recording.writer_process import DIED
from wrenchflow.source import samples_of
from wrenchflow.spacemouse_models import model_of

CONFIG = CollectConfig(
    episodes=2, seed=3, tare_s=0.4, time_limit_s=1.2, realtime=True, device=DeviceConfig(patience_s=0.2)
)


WAIT = realtime.Beat._wait


class Puppet:
    """A device that a test plays: `plays(count, now_ns)` gives what it says at each read, or raises."""

    name, full_scale_counts = "puppet", 350

    def __init__(self, plays=None):
        self.plays, self.reads, self.times, self.felt, self.closed = plays, 0, [], [], 0

    def read(self, now_ns):
        self.times.append(now_ns)
        self.reads += 1
        if self.plays is None:
            return Reading(t_ns=now_ns)
        return self.plays(self.reads - 1, now_ns)

    def feel(self, share):
        self.felt.append(share)

    def close(self):
        self.closed += 1


class Fingers:
    """A terminal at which keys are pressed when so many looks have been taken, and at questions."""

    def __init__(self, presses=(), answers=()):
        self.is_there, self.looks, self.presses, self.answers = True, 0, dict(presses), list(answers)
        self.is_asked = False

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.is_there = False

    def pressed(self, names=None):
        if self.is_asked:
            return [self.answers.pop(0)]
        self.looks += 1
        return [self.presses[self.looks]] if self.looks in self.presses else []


class Heard(Nowhere):
    """A board that remembers."""

    def __init__(self, fingers=None):
        self.said, self.asked, self.discarded, self.fingers = [], [], [], fingers

    def discard(self, shown):
        self.discarded.append(shown)

    def say(self, text):
        self.said.append(text)

    def ask(self, question):
        self.fingers.is_asked = bool(question)
        if question:
            self.asked.append(question)


class InMemory:
    """A recorder without a process, which takes seconds to start; `test_realtime` has the real one."""

    is_alive, dropped = True, 0

    def __init__(self, path, *, id, task, sources, meta, attachments, **_):
        self.path, self.clock, self.sources = path, Clock.start(), {source.name: source for source in sources}
        self.rows = {name: [] for name in self.sources}
        self.events, self.known = [], (id, task, meta, attachments)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        """There is nothing to end."""

    def push(self, source, row):
        self.rows[source].append(row.copy())

    def event(self, event):
        self.events.append(event)

    def finish(self, result, safety):
        id, task, meta, attachments = self.known
        streams = {}
        for name, source in self.sources.items():
            rows = np.concatenate(self.rows[name])
            for column in source.columns:
                samples = samples_of(rows, column, int(rows["t_ns"][0]))
                streams[column.name] = Stream(samples.t, samples.data, column.signal, column.frame)
        meta = {**meta, "result": result, "safety": safety}
        write_episode(self.path, Episode(id, task, streams, tuple(self.events), meta, attachments=attachments))
        return {}


@pytest.fixture(autouse=True)
def _without_waiting(monkeypatch):
    """As fast as it goes: what is tested does not depend on the clock."""
    monkeypatch.setattr(realtime.Beat, "_wait", lambda self, until_ns: None)
    monkeypatch.setattr(realtime, "Recorder", InMemory)


@pytest.fixture
def session(tmp_path, monkeypatch, unchecked):
    """Run one; returns what was kept and the board."""

    def run(*, device=None, fingers=None, config=CONFIG, **more):
        board = Heard(fingers)
        if fingers is not None:
            monkeypatch.setattr(sitting, "Keys", lambda releases: fingers)
        kept = []
        with unchecked():
            for shown in collect_folder(tmp_path / "raw", config, device=device or Puppet(), board=board, **more):
                kept.append(shown)
        return kept, board

    return run


def recordings(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*.mcap"))


def test_right_ends_and_keeps_left_discards_and_does_the_same_again_escape_stops(tmp_path, session):
    # Looks: one as each attempt begins, then one a period. The second attempt is discarded, its second go ended, and
    # escape says during the third, at its very beginning, that there shall be no fourth.
    fingers = Fingers({121: "right", 121 + 131: "left", 252 + 141: "right", 393 + 11: "escape"})
    kept, board = session(fingers=fingers, config=replace(CONFIG, episodes=5))
    ids = [shown.id for shown in kept]
    assert [shown.outcome.failure for shown in kept] == ["operator: ended", "operator: ended", "timeout"]
    assert [shown.id for shown in board.discarded] == [ids[1]]
    assert recordings(tmp_path / "raw") == [f"discarded/{ids[1]}-1.mcap", *(f"{id}.mcap" for id in ids)]
    again, before = (read_episode(tmp_path / "raw" / path) for path in (f"{ids[1]}.mcap", f"discarded/{ids[1]}-1.mcap"))
    np.testing.assert_array_equal(again["goal_pose"].data, before["goal_pose"].data)
    assert again.meta["simulator"]["state"] == before.meta["simulator"]["state"]
    assert before.meta["result"]["failure"] == "operator: discarded"
    assert len(before["teleop/joy"]) == 130
    assert len(again["teleop/joy"]) == 140
    assert read_manifest(tmp_path / "raw")["config"]["episodes"] == 3
    more, _ = session(fingers=Fingers(), config=replace(CONFIG, episodes=4), resume=True)
    assert [shown.id for shown in more[:3]] == ids
    assert [shown.was_there for shown in more] == [True, True, True, False]
    assert read_manifest(tmp_path / "raw")["config"]["episodes"] == 4


def test_escape_before_an_attempt_that_is_discarded_keeps_what_was_there(tmp_path, session):
    kept, board = session(
        fingers=Fingers({111: "right", 131: "escape", 241: "left"}), config=replace(CONFIG, episodes=5)
    )
    assert len(kept) == len(board.discarded) == 1
    assert read_manifest(tmp_path / "raw")["config"]["episodes"] == 1


def test_an_arrow_in_the_first_instant_was_meant_for_the_attempt_before(session):
    kept, board = session(fingers=Fingers({3: "left", 60: "right", 99: "left", 150: "escape"}))
    assert [shown.outcome.failure for shown in kept] == ["timeout"]
    assert board.discarded == []
    assert GRACE_S == 0.5  # So it is what the looks above, of 5 ms each, are about.


def test_escape_twice_ends_an_attempt_however_young(session):
    kept, _ = session(fingers=Fingers({3: "escape", 5: "escape"}))
    assert [shown.outcome.failure for shown in kept] == ["operator: ended"]
    assert kept[0].outcome.duration_s < 0.1


def test_what_an_emergency_stop_ended_is_set_aside_and_done_again(tmp_path, session):
    def stopped(count, now_ns):
        if count == 260:  # In the second attempt.
            signal.raise_signal(signal.SIGUSR1)
        return Reading(t_ns=now_ns)

    with pytest.raises(ControlError, match="emergency stop") as caught:
        session(device=Puppet(stopped))
    folder = tmp_path / "raw.partial"
    assert caught.value.__notes__ == [f"1 of 2 episodes are in '{folder}'."]
    kept, braked = (folder / path for path in sorted(recordings(folder), reverse=True))
    assert braked.parent.name == "discarded"
    before = read_episode(braked)
    assert before.meta["result"]["failure"] == "stopped: emergency-stop"
    first = kept.read_bytes()
    shown, _ = session(resume=True)
    assert [(one.id, one.was_there) for one in shown] == [(kept.stem, True), (before.id, False)]
    assert (tmp_path / "raw" / kept.name).read_bytes() == first
    assert (tmp_path / "raw" / "discarded" / braked.name).exists()
    again = read_episode(tmp_path / "raw" / f"{before.id}.mcap")
    assert again.meta["simulator"]["state"] == before.meta["simulator"]["state"]


def test_an_attempt_whose_control_process_died_is_set_aside_and_done_again(tmp_path, session):
    (first, _), _ = session()
    path = tmp_path / "raw" / f"{first.id}.mcap"
    whole = read_episode(path)
    path.unlink()
    write_episode(path, whole.with_meta(result={"success": False, "failure": DIED}))
    shown, _ = session(resume=True)
    assert [one.was_there for one in shown] == [True, False]  # Those that are there are told first.
    assert (tmp_path / "raw" / "discarded" / f"{first.id}-1.mcap").exists()
    assert read_episode(path).meta["result"]["failure"] == "timeout"


def test_what_was_only_discarded_is_not_done_away_with_by_the_next_run(tmp_path, session):
    with pytest.raises(OutputError, match="no episode was kept"):
        session(fingers=Fingers({11: "escape", 131: "left"}))
    (discarded,) = (tmp_path / "raw.partial" / "discarded").iterdir()
    with pytest.raises(OutputError, match="holds what an interrupted run recorded"):
        session()
    assert discarded.exists()


def test_a_review_asks_after_each_attempt_that_nobody_ended(tmp_path, session):
    fingers = Fingers({111: "right"}, answers=["left", "right"])
    kept, board = session(fingers=fingers, review=True)
    assert len(kept) == 2
    assert len(board.discarded) == 1
    assert len(board.asked) == 2
    assert all("timeout" in question and "left: discard" in question for question in board.asked)


def test_without_a_terminal_nobody_is_asked(session):
    kept, board = session(review=True)
    assert len(kept) == 2
    assert board.asked == []


def test_what_a_person_marks_is_an_event(tmp_path, session):
    device = Puppet(lambda count, now_ns: Reading(t_ns=now_ns, buttons=2 if 20 <= count < 30 or count >= 110 else 0))
    session(device=device, config=replace(CONFIG, episodes=1))
    episode = read_episode(next((tmp_path / "raw").glob("*.mcap")))
    joy, marks = episode["teleop/joy"], episode.events_of("mark")
    assert [(mark.start_ns, mark.stop_ns) for mark in marks] == [
        (joy.t[20], joy.t[30]),
        (joy.t[110], episode["tcp_pose"].t[-1]),
    ]
    assert episode.meta["device"] == {"name": "puppet", "full_scale_counts": 350}
    assert len(device.felt) == len(joy)


def deflected(now_ns, **more):
    return Reading(t_ns=now_ns, counts=np.array([0, 200, 0, 0, 0, 0]), **more)


def garbled(count, now_ns):
    return deflected(now_ns, problem="a report of 3 bytes" if 40 <= count < 60 else "")


def silent(count, now_ns, last=[0]):  # noqa: B006, a place to remember in
    last[0] = now_ns if count < 40 else last[0]
    return deflected(last[0])


def gone(count, now_ns):
    if count >= 40:
        raise DeviceError("the puppet has gone: tie it on again.")
    return deflected(now_ns)


def test_a_device_that_garbles_for_a_moment_stops_the_arm_for_a_moment(tmp_path, session):
    kept, _ = session(device=Puppet(garbled), config=replace(CONFIG, episodes=1))
    assert kept[0].outcome.failure == "timeout"
    episode = read_episode(next((tmp_path / "raw").glob("*.mcap")))
    t, twist = episode["teleop/twist"].t, episode["teleop/twist"].data
    (problem,) = episode.events_of("device")
    assert (problem.start_ns, problem.stop_ns, problem.label) == (t[40], t[60], "a report of 3 bytes")
    assert (twist[40:60] == 0.0).all()
    assert (twist[:40, 1] > 0.0).all()
    assert (twist[60:, 1] > 0.0).all()


@pytest.mark.parametrize(
    ("plays", "failure"),
    [(silent, "device: the device is silent"), (gone, "device: the puppet has gone: tie it on again.")],
)
def test_a_lost_device_ends_the_session_with_what_was_recorded(tmp_path, session, plays, failure):
    first = Puppet()
    device = Puppet(lambda count, now_ns: plays(count, now_ns))
    session(device=first, config=replace(CONFIG, episodes=1))
    with pytest.raises(DeviceError) as caught:
        session(device=device, config=replace(CONFIG, episodes=3), resume=True)
    assert str(caught.value) == failure
    folder = tmp_path / "raw.partial"
    assert caught.value.__notes__ == [f"2 of 3 episodes are in '{folder}': --resume goes on with them."]
    episode = read_episode(sorted(folder.glob("*.mcap"))[1])
    assert episode.meta["result"]["failure"] == failure
    assert episode.events[-1].kind == "failure" or episode.events_of("failure")[0].label == failure
    assert episode.events_of("device")[-1].label == failure.removeprefix("device: ")
    # From the moment on at which it was lost, the target stays, and so does the arm.
    lost_ns = episode.events_of("device")[-1].start_ns
    target = episode["target_pose"].between(lost_ns + 5_000_000, episode.span_ns[1] + 1)
    assert len(target) > 150
    assert np.ptp(target.data, axis=0).max() < 1e-15
    kept, _ = session(device=Puppet(), config=replace(CONFIG, episodes=3), resume=True)
    assert [shown.was_there for shown in kept] == [True, True, False]


def test_a_lost_device_is_asked_for_where_there_is_somebody(tmp_path, monkeypatch, unchecked):
    devices = [Puppet(gone), DeviceError("no puppet is there."), Puppet(), Puppet()]
    opened = []

    def open_device(config, keys):
        opened.append(devices.pop(0))
        if isinstance(opened[-1], DeviceError):
            raise opened[-1]
        return opened[-1]

    monkeypatch.setattr(sitting, "open_device", open_device)
    fingers = Fingers(answers=["left", "left"])
    board = Heard(fingers)
    monkeypatch.setattr(sitting, "Keys", lambda releases: fingers)
    config = replace(CONFIG, operator="spacemouse", realtime=False)
    with unchecked():
        kept = list(collect_folder(tmp_path / "raw", config, board=board))
    assert [shown.outcome.failure for shown in kept] == ["timeout", "timeout"]
    assert len(board.discarded) == 1
    assert [question.split("\n")[0] for question in board.asked] == [
        "device: the puppet has gone: tie it on again.",
        "no puppet is there.",
    ]
    assert [device.closed > 0 for device in opened if isinstance(device, Puppet)] == [True, True]


def test_the_clock_of_a_device_never_goes_back(session, monkeypatch):
    monkeypatch.setattr(realtime.Beat, "_wait", WAIT)
    device = Puppet()
    kept, _ = session(device=device)
    assert len(kept) == 2
    assert all(a < b for a, b in itertools.pairwise(device.times))


def test_a_device_that_is_not_there_leaves_nothing_behind(tmp_path, wrenchflow):
    for flags, said in (
        (("keyboard",), "no keyboard is there"),
        (("replay",), "give --device.recording"),
        (("lerobot",), "give --device.kind"),
        (("lerobot", "--device.kind", "so101_leader", "--device.settings", "port=/dev/no-tty"), "is not installed: "),
        (("lerobot", "--device.kind", "phone", "--device.settings", "colour=red"), "unknown setting 'colour'"),
        (("lerobot", "--device.kind", "so101_leader"), "'so101_leader' needs port. Its settings are port, "),
    ):
        ran = wrenchflow("collect", tmp_path / "raw", "--operator", *flags, "--episodes", 1)
        assert ran.code == 1
        assert said in ran.stderr
        assert ran.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_device_that_goes_between_being_found_and_being_read_leaves_nothing_behind(tmp_path, wrenchflow, monkeypatch):
    wire = Wire()
    wire.unplug()
    model = model_of(0x256F, 0xC635)
    assert model is not None
    mouse = spacemouse.SpaceMouse(wire, model)
    monkeypatch.setattr(spacemouse, "open_spacemouse", lambda buttons: mouse)
    ran = wrenchflow("collect", tmp_path / "raw", "--operator", "spacemouse", "--episodes", 1)
    assert ran.code == 1
    assert "has gone (read error)" in ran.stderr
    assert wire.is_closed
    assert list(tmp_path.iterdir()) == []


def test_what_has_speeds_begins_each_attempt_at_the_slowest(session):
    class Fast(Puppet):
        """One that is set to full speed in every attempt."""

        speed, slowed = ("4", 1.0), 0

        def slow_down(self):
            self.slowed += 1

    device = Fast()
    session(device=device)
    assert device.slowed == CONFIG.episodes


def test_a_recording_is_played_again_report_for_report(tmp_path, wrenchflow):
    flags = ("--episodes", 1, "--seed", 3, "--tare-s", 0.4)
    wrenchflow("collect", tmp_path / "raw", *flags, "--operator", "emulated", "--jobs", 1, "--json")
    (path,) = (tmp_path / "raw").glob("*.mcap")
    ran = wrenchflow(
        *("collect", tmp_path / "again", *flags, "--operator", "replay", "--time-limit-s", 8, "--no-viewer"),
        *("--device.recording", path, "--json"),
    )
    assert ran.result["episodes"] == 1
    before, again = (read_episode(next((tmp_path / name).glob("*.mcap"))) for name in ("raw", "again"))
    count = min(len(before["teleop/joy"]), len(again["teleop/joy"]))
    assert count > 200
    np.testing.assert_array_equal(again["teleop/joy"].data[:count], before["teleop/joy"].data[:count])
