"""What the safety layer did stands in the recording: as a stream, as events, and as figures that `info` shows."""

import numpy as np
import pytest

from wrenchflow.control.plan import Plan, packet_of
from wrenchflow.control.safeguards import HOLD, LEASH, MODES, NO_CAUSE, RUN, SAFEGUARDS, SILENCE
from wrenchflow.ledger import Ledger
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode
from wrenchflow.signals import GOVERNOR
from wrenchflow.sim.attempt import Attempt
from wrenchflow.sim.config import AttemptConfig


@pytest.fixture
def episode(peg, peg_model, rig):
    """An attempt of a second, whose rows say that it waited, ran on the leash, and was held."""
    attempt = Attempt(peg, peg_model, rig, AttemptConfig(tare_s=0.5), seed=(0, 1))
    attempt.follow(499)
    governor = attempt.plant.recorded["governor"]
    governor[:] = 0.0
    columns = {name: governor[:, k] for k, name in enumerate(GOVERNOR.columns)}
    columns["mode"][:], columns["cause"][:] = HOLD, NO_CAUSE
    columns["mode"][501:900] = RUN
    columns["cause"][900:] = SILENCE
    columns["acting"][600:700] = 1 << LEASH
    columns["tank"][:] = np.linspace(2.0, 0.5, len(governor))
    columns["force"][:] = 7.25
    return attempt.episode("0007", {}, [])


def test_it_is_read_as_it_was(tmp_path, episode):
    write_episode(tmp_path / "0007.mcap", episode)
    read = read_episode(tmp_path / "0007.mcap")
    (held,) = read.events_of("safety")
    t = read["governor"].t
    assert (held.start_ns, held.stop_ns, held.label) == (t[900], t[-1], "hold: silence")
    assert read.meta["governor"] == {"modes": list(MODES), "safeguards": list(SAFEGUARDS)}
    ledger = Ledger.of(read)
    assert ledger is not None
    assert read.meta["safety"] == {**ledger.summary(), "refusals": {}} == episode.meta["safety"]
    assert ledger.summary()["ticks"] == {"waiting": 501, "run": 399, "hold": 100}


def test_what_was_refused_is_named_in_the_events_the_figures_and_by_info(tmp_path, peg, peg_model, rig, wrenchflow):
    attempt = Attempt(peg, peg_model, rig, AttemptConfig(tare_s=0.5), seed=(0, 1))
    pose = attempt.controller.target_pose[None]

    def send(t_obs_ns: int, poses: np.ndarray) -> str:
        t, kind = attempt.now_ns + 200_000_000 + np.arange(len(poses)), attempt.impedance
        return attempt.accept(packet_of(Plan.of_poses(t, poses, kind, t_obs_ns=t_obs_ns, period_ns=50_000_000)))

    sent = [attempt.now_ns, attempt.now_ns, attempt.now_ns - 10**10, attempt.now_ns + 1]
    assert [send(t_obs_ns, pose) for t_obs_ns in sent] == ["accepted", "replayed", "reordered", "future"]
    attempt.follow(200)
    assert send(attempt.now_ns, np.full((1, 7), np.nan)) == "not-finite"
    refused_ns = [sent[0], attempt.now_ns]
    attempt.follow(20)
    episode = attempt.episode("0007", {}, [])
    refused = [event for event in episode.events_of("safety") if event.label.startswith("refused")]
    assert [(event.start_ns, event.label) for event in refused] == [
        (refused_ns[0], "refused: replayed, reordered, future"),
        (refused_ns[1], "refused: not-finite"),
    ]
    assert episode.meta["safety"]["refusals"] == {"not-finite": 1, "replayed": 1, "reordered": 1, "future": 1}
    assert episode.meta["safety"]["interventions"]["gate-request"] == 2
    write_episode(tmp_path / "0007.mcap", episode)
    lines = wrenchflow("info", tmp_path / "0007.mcap").stdout.splitlines()
    assert "refused     not-finite 1, replayed 1, reordered 1, future 1" in lines


def test_info_shows_it_in_three_lines(tmp_path, episode, wrenchflow):
    write_episode(tmp_path / "0007.mcap", episode)
    assert wrenchflow("info", tmp_path / "0007.mcap", "--json").result["safety"] == episode.meta["safety"]
    lines = wrenchflow("info", tmp_path / "0007.mcap").stdout.splitlines()
    assert "modes       waiting 501, run 399, hold 100 ticks; entered hold: silence (1)" in lines
    assert "intervened  leash 100 ticks" in lines
    extremes = "leash in 20.0% of the ticks, tank down to 0.50 J, force up to 7.2 N, moment up to 0.00 N.m"
    assert f"extremes    {extremes}" in lines


def test_info_of_who_records_something_else_under_that_name_is_without_it(tmp_path, episode, wrenchflow):
    write_episode(tmp_path / "0007.mcap", episode.with_meta(safety={"ticks": 7}))
    said = wrenchflow("info", tmp_path / "0007.mcap")
    assert said.code == 0
    assert "modes" not in said.stdout
