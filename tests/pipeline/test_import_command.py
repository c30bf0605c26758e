"""The two real recordings, imported by the command line with the mappings that come as examples."""

import hashlib
from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat

from wrenchflow.recording.reader import read_episode

ROOT = Path(__file__).parents[2]
RECORDINGS, EXAMPLES = ROOT / "tests" / "recordings", ROOT / "examples" / "imports"
SCREW = RECORDINGS / "screw_driving" / "sensor_data.csv"
GUIDED = RECORDINGS / "panda_hand_guiding" / "17_symbol_data.mat"


@pytest.fixture(scope="module")
def screw(wrenchflow, tmp_path_factory):
    out = tmp_path_factory.mktemp("screw") / "raw"
    said = wrenchflow("import", EXAMPLES / "screw_driving.toml", out, SCREW, "--json", "--jobs", "1").result
    return said, read_episode(out / "sensor_data.mcap")


@pytest.fixture(scope="module")
def guided(wrenchflow, tmp_path_factory):
    out = tmp_path_factory.mktemp("guided") / "raw"
    said = wrenchflow("import", EXAMPLES / "panda_hand_guiding.toml", out, GUIDED, "--json", "--jobs", "1").result
    return said, [read_episode(path) for path in sorted(out.glob("*.mcap"))]


def test_screw_driving_has_the_figures_that_it_is_known_for(screw):
    said, episode = screw
    assert (said["episodes"], list(said["notes"])) == (1, ["sensor_data"])
    figures = episode.meta["import"]["estimates"]["streams"]
    of_wrench = figures["wrench_raw"]
    assert of_wrench["samples"] == 726
    assert (of_wrench["median_step_ms"], of_wrench["shortest_step_ms"]) == pytest.approx((21.0, 18.0))
    assert of_wrench["longest_step_ms"] == pytest.approx(153.0)
    assert of_wrench["mean_rate_hz"] == pytest.approx(30.5, abs=0.05)
    assert figures["tcp_twist"]["repeated_rows"] == 566
    assert episode.duration_s == pytest.approx(23.8, abs=0.05)
    fz_n = episode["wrench_raw"].column("fz")
    assert (fz_n.max(), fz_n.min()) == pytest.approx((-23.7, -25.8), abs=0.1)


def test_screw_driving_is_the_table_to_the_bit(screw):
    _, episode = screw
    names = SCREW.read_text().split("\n", 1)[0].split(",")
    table = np.loadtxt(SCREW, delimiter=",", skiprows=1)
    parts = {"wrench_raw": "Fx Fy Fz Tx Ty Tz", "tcp_position": "X Y Z", "tcp_twist": "Vx Vy Vz Wx Wy Wz"}
    for name, columns in parts.items():
        np.testing.assert_array_equal(episode[name].data, table[:, [names.index(each) for each in columns.split()]])
    np.testing.assert_array_equal(episode["controller"].column("Rot_Kx"), table[:, names.index("Rot_Kx")])
    np.testing.assert_array_equal(episode["wrench_raw"].t, table[:, 0].astype(np.int64) * 1_000_000)
    assert episode.meta["import"]["source"]["files"] == {SCREW.name: hashlib.sha256(SCREW.read_bytes()).hexdigest()}
    # Nobody states the order of its Euler angles.
    assert "tcp_pose" not in episode
    assert any("in which order" in note for note in episode.meta["import"]["notes"])


def test_hand_guiding_is_told_how_fast_it_was_sampled(guided):
    said, episodes = guided
    assert said["episodes"] == len(episodes) == 3
    for episode in episodes:
        about = episode.meta["import"]
        rate = about["estimates"]["rate"]
        assert rate["step_ms"][:2] == pytest.approx([1.44, 1.44], abs=0.02)
        assert min(rate["r_squared"][:2]) > 0.995
        assert rate["rate_hz"] == pytest.approx(694, abs=5)
        assert about["assumptions"]["rate_hz"] == [1000.0]
        (note,) = (note for note in about["notes"] if "no clock" in note)
        assert "1000 Hz" in note
        assert "1.44 ms" in note
        figures = about["estimates"]["streams"]["wrench_raw"]
        assert figures["repeated_rows"] / figures["samples"] == pytest.approx(0.30, abs=0.01)


def test_hand_guiding_is_the_struct_array_to_the_bit(guided):
    _, episodes = guided
    takes = loadmat(GUIDED)["symbol_data"].ravel()
    for episode, take in zip(episodes, takes, strict=True):
        for name, field in {"wrench_raw": "F", "tcp_position": "pos", "tcp_velocity": "vel"}.items():
            np.testing.assert_array_equal(episode[name].data, take[field].T)
        assert episode["wrench_raw"].signal.kind == "force"


def test_the_number_of_workers_changes_no_byte_and_a_person_reads_each_note_once(wrenchflow, tmp_path):
    for jobs in (1, 2):
        others = tmp_path / f"{jobs}" / "log.csv"
        others.parent.mkdir()
        others.write_bytes(SCREW.read_bytes())
        ran = wrenchflow(
            "import", EXAMPLES / "screw_driving.toml", tmp_path / f"out{jobs}", SCREW, others, "--jobs", jobs
        )
        assert ran.code == 0, ran.stderr
        assert ran.stdout.count("note (all): The source does not say in which frame") == 1
    for path in (tmp_path / "out1").iterdir():
        assert path.read_bytes() == (tmp_path / "out2" / path.name).read_bytes()


def test_what_is_there_is_replaced_when_told(wrenchflow, tmp_path):
    arguments = ["import", EXAMPLES / "screw_driving.toml", tmp_path / "raw", SCREW, "--jobs", 1]
    assert wrenchflow(*arguments).code == 0
    again = wrenchflow(*arguments)
    assert (again.code, again.stdout) == (1, "")
    assert "exists already" in again.stderr
    assert wrenchflow(*arguments, "--overwrite").code == 0
