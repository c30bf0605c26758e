"""A stage that moves an arm checks it once before it begins, and does not begin where a check fails."""

import json
from functools import partial

import pytest

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import demonstrate
from wrenchflow.recording.write import write_episode
from wrenchflow.sim import startup
from wrenchflow.sim.ft_sensor import SensorFaults
from wrenchflow.sim.plant import Measurement


@pytest.mark.parametrize("stage", ["raw", "rollouts"])
def test_what_the_checks_found_is_in_the_manifest(chain, stage):
    found = json.loads((chain.folder / stage / "manifest.json").read_text())["startup"]
    assert found["mass_kg"] == pytest.approx(0.45, abs=0.05)
    assert found["compliance"] == pytest.approx([1.0, 1.0, 1.0], abs=0.05)


def test_the_checks_change_no_bit_of_what_is_recorded(chain, unchecked, tmp_path):
    """The folder was recorded by a stage that checked first; this attempt was not."""
    with unchecked():
        episode = demonstrate(3, CollectConfig(episodes=6, seed=5))
    write_episode(tmp_path / "alone.mcap", episode)
    assert (tmp_path / "alone.mcap").read_bytes() == (chain.folder / "raw" / f"{episode.id}.mcap").read_bytes()


@pytest.mark.parametrize("stage", ["collect", "deploy"])
def test_a_stage_does_not_begin_with_an_arm_that_is_not_fit(chain, wrenchflow, monkeypatch, tmp_path, stage):
    leant_on = partial(Measurement, sensor=SensorFaults(bias_force_n=40.0))
    monkeypatch.setattr(startup, "Measurement", leant_on)
    reads = [chain.folder / "run"] if stage == "deploy" else []
    ran = wrenchflow(stage, *reads, tmp_path / "out", "--episodes", 2, "--jobs", 1)
    assert (ran.code, ran.stdout, ran.stderr.count("\n")) == (1, "", 1)
    assert ran.stderr.startswith("wrenchflow: something touches the tool, or the sensor needs to be zeroed: got ")
    assert [path.name for path in tmp_path.rglob("*")] == ["out.partial"]


@pytest.mark.parametrize(("stage", "jobs"), [("collect", 1), ("collect", 2), ("deploy", 1)])
def test_a_stage_checks_once_and_not_once_an_episode(chain, wrenchflow, monkeypatch, tmp_path, stage, jobs):
    checks = []

    def counted(*arguments):
        checks.append(arguments)
        return check(*arguments)

    check = startup.check_startup
    monkeypatch.setattr(startup, "check_startup", counted)
    reads = [chain.folder / "run"] if stage == "deploy" else []
    assert wrenchflow(stage, *reads, tmp_path / "out", "--episodes", 2, "--jobs", jobs).code == 0
    assert len(checks) == 1
