from dataclasses import replace
from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from wrenchflow.config import to_mapping
from wrenchflow.errors import ConfigError
from wrenchflow.rig import RIGS, load_rig, rig_of


def test_poses_of_the_rig_are_poses():
    rig = load_rig("panda_peg")
    for pose in (rig.T_flange_tcp, rig.sensor.T_flange_sensor):
        assert np.linalg.norm(pose[3:]) == pytest.approx(1.0, abs=1e-12)
    assert all(low < high for low, high in zip(rig.workspace.min_m, rig.workspace.max_m, strict=True))
    np.testing.assert_array_equal(rig.sensor.noise, [0.2] * 3 + [0.007] * 3)
    np.testing.assert_array_equal(rig.sensor.range, [200.0] * 3 + [10.0] * 3)


def test_a_recording_carries_its_rig():
    rig = load_rig("panda_peg")
    assert rig_of({"rig": to_mapping(rig)}, "0001.mcap") == rig
    with pytest.raises(ConfigError, match=r"^0001.mcap carries no rig"):
        rig_of({}, "0001.mcap")


def test_a_rig_of_ones_own_is_a_toml_file(tmp_path: Path):
    text = (resources.files("wrenchflow") / "panda_peg.toml").read_text()
    path = tmp_path / "mine.toml"
    path.write_text(text.replace("mass_kg = 0.45", "mass_kg = 0.6"))
    assert load_rig(str(path)).payload.mass_kg == 0.6
    path.write_text(text.replace("mass_kg", "mas_kg"))
    with pytest.raises(ConfigError, match="Did you mean 'mass_kg'"):
        load_rig(str(path))


def test_a_rig_that_does_not_exist_is_refused_with_the_nearest_one(tmp_path: Path):
    with pytest.raises(ConfigError, match=r"^unknown rig 'panda_pegg'\. Did you mean 'panda_peg'\?"):
        load_rig("panda_pegg")
    with pytest.raises(ConfigError, match="does not exist"):
        load_rig(str(tmp_path / "none.toml"))


@pytest.mark.parametrize(
    ("was", "is_", "message"),
    [
        ("min_m = [0.25", "min_m = [nan", r"workspace\.min_m holds nan"),
        ("min_m = [0.25", "min_m = [0.80", r"workspace reaches from 0\.8 to 0\.75"),
        ("mass_kg = 0.45", "mass_kg = -1.0", r"payload\.mass_kg is -1"),
        ("mass_kg = 0.45", "mass_kg = inf", r"payload\.mass_kg holds inf"),
        ("rate_hz = 1000.0", "rate_hz = 0.0", r"sensor\.rate_hz holds 0"),
        ("lowpass_hz = 150.0", "lowpass_hz = 0.0", r"sensor\.lowpass_hz holds 0"),
        ("0.9238795325112867", "0.0", "T_flange_tcp has a quaternion .* of length 0.38"),
    ],
)
def test_limits_that_are_no_limits_are_refused(tmp_path: Path, was: str, is_: str, message: str):
    text = (resources.files("wrenchflow") / "panda_peg.toml").read_text()
    assert was in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(was, is_, 1))
    with pytest.raises(ConfigError, match=message):
        load_rig(str(path))


def test_a_rig_that_extends_another_is_that_one_but_for_what_it_says(tmp_path: Path):
    peg, path = load_rig("panda_peg"), tmp_path / "mine.toml"
    path.write_text('extends = "panda_peg"\n[payload]\nmass_kg = 0.6\n')
    assert load_rig(str(path)) == replace(peg, payload=replace(peg.payload, mass_kg=0.6))
    # A path is from the rig's own folder on, lists come as a whole, and so on through any number of rigs.
    (tmp_path / "yours.toml").write_text('extends = "mine.toml"\ncameras = []\n[robot]\ntcp_speed_m_s = 0.7\n')
    slow = replace(peg.robot, tcp_speed_m_s=0.7)
    assert load_rig(str(tmp_path / "yours.toml")) == replace(load_rig(str(path)), cameras=(), robot=slow)


def test_every_rig_that_comes_along_is_whole_in_a_recording():
    for name in RIGS:
        rig = load_rig(name)
        assert rig_of({"rig": to_mapping(rig)}, "0001.mcap") == rig
        assert "extends" not in to_mapping(rig)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('extends = "mine.toml"', r"^rig 'mine\.toml' extends 'mine\.toml', expected a rig that ends this\.$"),
        ('extends = "../rigs/mine.toml"', r"^rig 'mine\.toml' extends 'mine\.toml', expected a rig that ends this\.$"),
        ('extends = "panda_pegg"', r"^unknown rig 'panda_pegg'\. Did you mean 'panda_peg'\?"),
        ("extends = 3", r"^mine\.toml\.extends: expected the name or the path of a rig, got 3\.$"),
        (
            'extends = "panda_peg"\n[paylod]\nmass_kg = 1.0',
            r"^mine\.toml: unknown key 'paylod'\. Did you mean 'payload'",
        ),
    ],
)
def test_a_rig_that_extends_nothing_sound_is_refused(tmp_path: Path, text: str, message: str):
    path = tmp_path / "rigs" / "mine.toml"
    path.parent.mkdir()
    path.write_text(text)
    with pytest.raises(ConfigError, match=message):
        load_rig(str(path))
