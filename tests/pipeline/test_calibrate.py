"""`calibrate`, and who uses what it found, as a person meets them."""

import json
from dataclasses import replace

import pytest

from wrenchflow.calibration import load_calibration, toml_of
from wrenchflow.recording.reader import read_episode
from wrenchflow.told import calibration_lines

MASS_KG, COM_M = 0.47, (0.002, 0.0, 0.05)


@pytest.fixture(scope="module")
def made(wrenchflow, tmp_path_factory):
    """A tool that is nearly the rig's, calibrated in simulation."""
    folder = tmp_path_factory.mktemp("calibrate")
    ran = wrenchflow(
        "calibrate", folder / "tool.toml", "--json", "--true-mass-kg", MASS_KG, "--true-com-sensor-m", *COM_M
    )
    return folder, ran


def test_the_simulated_arm_finds_its_tool_and_leaves_what_it_is_from(made, wrenchflow):
    folder, ran = made
    result = ran.result
    assert result["payload"]["mass_kg"] == pytest.approx(MASS_KG, abs=0.005)
    assert result["truth"] == {"mass_kg": MASS_KG, "com_sensor_m": list(COM_M)}
    assert result["sources"][0]["file"] == "tool.mcap"
    again = wrenchflow("calibrate", folder / "again.toml", folder / "tool.mcap", "--json").result
    assert again["payload"] == result["payload"]
    assert again["truth"] is None
    assert again["sources"] == result["sources"]


def test_text_shows_what_was_found_beside_what_is_true(made):
    lines = {line.split()[0]: line for line in calibration_lines(made[1].result)}
    assert [float(value) for value in lines["true"].split()[1:]] == [470.0, 2.0, 0.0, 50.0]
    assert float(lines["found"].split()[1]) == pytest.approx(470.0, abs=3.0)
    without = calibration_lines({**made[1].result, "truth": None})
    assert not [line for line in without if line.startswith("true")]


def test_what_is_refused_is_told_in_one_line_and_leaves_nothing(made, wrenchflow, tmp_path):
    folder, _ = made
    for arguments, says in (
        ((folder / "missing.mcap",), "missing.mcap"),
        ((folder / "tool.mcap", "--rests.max-spread", "0.5"), "rest 1 of 6 cannot be used: the reading spreads"),
    ):
        ran = wrenchflow("calibrate", tmp_path / "out.toml", *arguments)
        assert (ran.code, ran.stdout, ran.stderr.count("\n")) == (1, "", 1)
        assert says in ran.stderr
        assert not list(tmp_path.iterdir())
    assert wrenchflow("calibrate", folder / "tool.toml").code == 1


def test_demonstrations_carry_the_calibration(made, wrenchflow, tmp_path):
    folder, _ = made
    found = load_calibration(folder / "tool.toml")
    with_it = ("--calibration", folder / "tool.toml")
    assert (
        wrenchflow("collect", tmp_path / "raw", "--operator", "emulated", "--episodes", 1, "--jobs", 1, *with_it).code
        == 0
    )
    (path,) = (tmp_path / "raw").glob("*.mcap")
    meta = read_episode(path).meta
    assert meta["rig"]["payload"]["mass_kg"] == found.payload.mass_kg == meta["calibration"]["payload"]["mass_kg"]
    assert meta["calibration"]["file"] == "tool.toml"
    manifest = json.loads((tmp_path / "raw" / "manifest.json").read_text())
    assert manifest["config"]["calibration"].endswith("tool.toml")


def test_the_calibration_of_another_tool_stops_the_start(made, wrenchflow, tmp_path):
    found = load_calibration(made[0] / "tool.toml")
    heavy = replace(found, payload=replace(found.payload, mass_kg=0.9))
    (tmp_path / "heavy.toml").write_text(toml_of(heavy))
    ran = wrenchflow("collect", tmp_path / "raw", "--episodes", 1, "--calibration", tmp_path / "heavy.toml")
    assert ran.code == 1
    assert "the tool is not the rig's" in ran.stderr
