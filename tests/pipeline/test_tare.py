"""The tare before a demonstration: one that a push disturbs is refused with its reason, and done again."""

import mujoco
import numpy as np
import pytest

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import demonstrate
from wrenchflow.collect.tare import tares_of
from wrenchflow.errors import CalibrationError
from wrenchflow.process.calibration import bias_window, estimate_bias
from wrenchflow.process.config import BiasConfig
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode
from wrenchflow.sim.attempt import Attempt

CONFIG = CollectConfig(seed=4, tare_s=0.5, tare_wait_s=2.0, disturbance_m=0.0)
PUSH_N = 12.0


class PushedAttempt(Attempt):
    """Somebody presses against the tool from tick 300 on, for `pushed` ticks: what a careless hand does."""

    pushed = 400

    def _tick(self, ticks, drive=None):
        body = mujoco.mj_name2id(self.plant.model, mujoco.mjtObj.mjOBJ_BODY, "tool")
        while ticks:
            here = self.plant.count
            edge = next((e for e in (300, 300 + self.pushed) if e > here), here + ticks)
            count = min(ticks, edge - here)
            self.plant.data.xfrc_applied[body, 2] = PUSH_N if 300 <= here < 300 + self.pushed else 0.0
            super()._tick(count, drive)
            ticks -= count


@pytest.fixture(params=["scripted", "emulated"])
def config(request):
    return CollectConfig(seed=4, tare_s=0.5, tare_wait_s=2.0, operator=request.param)


def pushed(monkeypatch, ticks):
    monkeypatch.setattr(PushedAttempt, "pushed", ticks)
    monkeypatch.setattr("wrenchflow.collect.session.Attempt", PushedAttempt)


def test_a_push_is_refused_with_its_reason_and_the_tare_is_done_again(monkeypatch, unchecked, config, tmp_path):
    pushed(monkeypatch, 400)
    with unchecked():
        episode = demonstrate(0, config)
    refused = episode.events_of("tare")
    assert len(refused) == 1  # The push was over before the second one began.
    assert refused[0].label.startswith("refused: the ")
    (tare,) = [event for event in episode.events_of("phase") if event.label == "tare"]
    assert tare.start_ns - refused[0].stop_ns >= 2_000_000_000
    assert episode.meta["result"]["success"]
    # Who reads the recording tares by the same window, and finds nothing wrong with it.
    write_episode(tmp_path / "one.mcap", episode)
    read = read_episode(tmp_path / "one.mcap")
    assert read.events_of("tare") == refused
    start_ns, stop_ns = bias_window(read, BiasConfig())
    assert (start_ns, stop_ns) == (tare.start_ns, tare.stop_ns)


def test_the_safety_layer_forgets_the_bias_that_a_push_gave_it(monkeypatch, peg, peg_model, rig, unchecked):
    monkeypatch.setattr(PushedAttempt, "pushed", 400)
    with unchecked():
        disturbed = PushedAttempt(peg, peg_model, rig, CONFIG, seed=(4, 0, 0), tares=tares_of(CONFIG))
        quiet = Attempt(peg, peg_model, rig, CONFIG, seed=(4, 0, 0), tares=tares_of(CONFIG))
    apart_n = disturbed.controller.ctl[0]["bias"][:3] - quiet.controller.ctl[0]["bias"][:3]
    assert np.abs(apart_n).max() < 0.05
    # It felt the push before it forgot it.
    assert np.abs(disturbed.plant.recorded["wrench_raw"][300:500, 2]).max() > 0.5 * PUSH_N


def test_what_is_refused_too_often_ends_with_the_reason(monkeypatch, unchecked, config):
    pushed(monkeypatch, 100_000)
    with unchecked(), pytest.raises(CalibrationError, match=r"refused 3 times, the last time because: the "):
        demonstrate(0, config)


def test_who_rests_is_not_refused_and_nothing_changes(monkeypatch, unchecked, config):
    with unchecked():
        judged = demonstrate(0, config)
        monkeypatch.setattr("wrenchflow.collect.session.tares_of", lambda config: None)
        free = demonstrate(0, config)
    assert judged.streams == free.streams
    assert judged.events == free.events


def test_the_bias_of_a_repeated_tare_is_that_of_rest(monkeypatch, unchecked, rig):
    pushed(monkeypatch, 400)
    with unchecked():
        disturbed = demonstrate(0, CONFIG)
        monkeypatch.undo()
        quiet = demonstrate(0, CONFIG)
    biases = []
    for episode in (disturbed, quiet):
        start_ns, stop_ns = bias_window(episode, BiasConfig())
        streams = (episode["wrench_raw"], episode["tcp_pose"], episode["joint_states"])
        biases.append(estimate_bias(*streams, rig, start_ns=start_ns, stop_ns=stop_ns).mean)
    np.testing.assert_allclose(biases[0][:3], biases[1][:3], atol=0.15)
