"""Curation as a person does it: say, select, merge, split and export, while no recording changes by a byte."""

import json
import shutil

import h5py
import pyarrow.parquet as pq
import pytest

from wrenchflow.datasets.load import load_steps
from wrenchflow.recording.reader import read_episode


@pytest.fixture
def clean(chain, tmp_path):
    return shutil.copytree(chain.folder / "clean", tmp_path / "clean")


def ids(clean):
    return sorted(path.stem for path in clean.glob("*.mcap"))


def test_what_a_person_says_is_in_the_data_set_and_not_in_the_recordings(clean, wrenchflow, tmp_path):
    before = {path.name: path.read_bytes() for path in clean.iterdir() if path.is_file()}
    first, second, third, *_ = ids(clean)
    trim = ("--trim", 1.0, 2.5, "--mark", "insert:1.2:2.0", "--note", "slow start", "--by", "ann")
    assert wrenchflow("review", clean, "--episode", first, *trim).code == 0
    assert wrenchflow("review", clean, "--episode", second, "--label", "failure").code == 0
    assert wrenchflow("review", clean, "--episode", third, "--label", "unusable", "--note", "bumped").code == 0
    assert wrenchflow("review", clean, "--episode", first, "--task", "peg, blue").code == 0
    said = wrenchflow("review", clean, "--json").result
    assert said["reviewed"] == 3
    assert said["episodes"][f"{first}.mcap"]["note"] == "slow start"
    result = wrenchflow("export", "robomimic", clean, tmp_path / "data", "--jobs", 1, "--json").result
    assert result["left_out"] == {second: "not a success", third: "reviewed as unusable: bumped"}
    steps = {one.recording_id: one for one in load_steps(tmp_path / "data")}
    assert set(steps) == set(ids(clean)) - {second, third}
    whole = read_episode(clean / f"{first}.mcap")
    zero_ns = whole.span_ns[0]
    assert zero_ns + 1_000_000_000 <= steps[first].t[0]
    assert steps[first].t[-1] < zero_ns + 2_500_000_000
    assert steps[first].task == "peg, blue"
    assert {path.name: path.read_bytes() for path in clean.iterdir() if path.name in before} == before
    assert wrenchflow("review", clean, "--episode", first, "--clear", "--json").result["reviewed"] == 2


def test_a_selection_goes_through_to_the_masks(clean, wrenchflow, tmp_path):
    select = ("select", clean, tmp_path / "a.json", "--where", "duration_s > 0 and contacts >= 1 and not has('spike')")
    assert wrenchflow(*select, "--json").result["recordings"] == 6
    shares = ("--train", 0.5, "--valid", 0.25, "--test", 0.25)
    told = wrenchflow("split", tmp_path / "a.json", tmp_path / "b.json", *shares, "--json").result
    assert told["splits"]["train"] == 3
    assert sum(told["splits"].values()) == 6
    selection = json.loads((tmp_path / "b.json").read_text())
    assert [step["command"] for step in selection["made_by"]] == ["select", "split"]
    assert selection["sources"][0]["config"]["filter"]["cutoff_hz"] == 40.0
    assert all(len(entry["raw_sha256"]) == 64 for entry in selection["entries"])
    assert str(tmp_path) not in (tmp_path / "b.json").read_text()
    assert wrenchflow("export", "robomimic,lerobot", tmp_path / "b.json", tmp_path / "data", "--jobs", 1).code == 0
    wanted = {entry["id"]: entry["split"] for entry in selection["entries"]}
    with h5py.File(tmp_path / "data" / "robomimic.hdf5") as file:
        for side in ("train", "valid", "test"):
            named = [str(file[f"data/{name.decode()}"].attrs["recording_id"]) for name in file[f"mask/{side}"]]
            assert sorted(named) == sorted(id for id, split in wanted.items() if split == side)
    assert wrenchflow("validate", tmp_path / "data").code == 0


def test_masks_may_be_by_quality(clean, wrenchflow, tmp_path):
    forces = {row["id"]: row["max_force"] for row in pq.read_table(clean / "quality.parquet").to_pylist()}
    limit = sorted(forces.values())[2]
    export = (
        "export",
        "robomimic",
        clean,
        tmp_path / "data",
        "--jobs",
        1,
        "--masks",
        f"gentle=peak_force_n <= {limit}",
    )
    assert wrenchflow(*export).code == 0
    with h5py.File(tmp_path / "data" / "robomimic.hdf5") as file:
        named = {str(file[f"data/{name.decode()}"].attrs["recording_id"]) for name in file["mask/gentle"]}
        assert {"gentle_train", "gentle_valid"} < set(file["mask"])
    assert named == {id for id, force in forces.items() if force <= limit}
    assert len(named) == 3
    bad = wrenchflow("export", "robomimic", clean, tmp_path / "other", "--masks", "max_force < 3")
    assert (bad.code, "expected NAME=CONDITION" in bad.stderr) == (1, True)


def test_a_selection_moves_with_its_recordings_and_knows_them_again(clean, wrenchflow, tmp_path):
    first, second, *_ = ids(clean)
    assert wrenchflow("select", clean, tmp_path / "a.json", "--only-success").code == 0
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    shutil.move(clean, moved / "clean")
    shutil.move(tmp_path / "a.json", moved / "a.json")
    assert wrenchflow("export", "csv", moved / "a.json", moved / "data", "--jobs", 1).code == 0
    (moved / "clean" / f"{first}.mcap").write_bytes((moved / "clean" / f"{second}.mcap").read_bytes())
    changed = wrenchflow("export", "csv", moved / "a.json", moved / "other", "--jobs", 1)
    assert (changed.code, "is another recording than the one that was selected" in changed.stderr) == (1, True)
    (moved / "clean" / f"{first}.mcap").unlink()
    assert "is selected and not there" in wrenchflow("export", "csv", moved / "a.json", moved / "other").stderr


def test_merging_takes_a_recording_once_and_refuses_two_of_one_id(clean, wrenchflow, tmp_path):
    first, *_ = ids(clean)
    other = shutil.copytree(clean, tmp_path / "other")
    told = wrenchflow("merge", tmp_path / "m.json", clean, other, "--json").result
    assert told["recordings"] == 6
    assert json.loads((tmp_path / "m.json").read_text())["made_by"][-1]["taken_once"] == 6
    episode = read_episode(other / f"{first}.mcap")
    from wrenchflow.recording.write import write_episode

    (other / f"{first}.mcap").unlink()
    write_episode(other / f"{first}.mcap", episode.with_meta(changed=True))
    ran = wrenchflow("merge", tmp_path / "n.json", clean, other)
    assert (ran.code, f"two different recordings have the id {first}" in ran.stderr) == (1, True)


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (("--episode", "nobody", "--label", "failure"), "unknown episode 'nobody'"),
        (("--trim", "3", "1"), "expected 0 <= start < stop"),
        (("--trim", "0", "500"), "but it lasts"),
        (("--trim", "0.0001", "0.0002"), "samples of"),
        (("--mark", "insert"), "expected NAME:START:STOP"),
        (("--mark", "insert:1:2", "insert:1.5:3"), "overlap"),
        (("--mark", "insert:1:900"), "but it lasts"),
    ],
)
def test_what_a_recording_cannot_hold_is_refused(arguments, expected, clean, wrenchflow):
    episode = () if "--episode" in arguments else ("--episode", ids(clean)[0])
    ran = wrenchflow("review", clean, *episode, *arguments)
    assert (ran.code, expected in ran.stderr) == (1, True), ran.stderr
    assert not (clean / "review.json").exists()


def test_bad_input_of_curation_is_said_in_one_line(clean, wrenchflow, tmp_path):
    out = tmp_path / "out.json"
    assert "selects no recording" in wrenchflow("select", clean, out, "--where", "max_force > 1e9").stderr
    assert "does not exist" in wrenchflow("select", tmp_path / "nowhere", out).stderr
    (tmp_path / "bad.json").write_text("{")
    assert "cannot be read as JSON" in wrenchflow("split", tmp_path / "bad.json", out).stderr
    (tmp_path / "bad.json").write_text('{"format": 1, "entries": [{}]}')
    assert "is no selection" in wrenchflow("split", tmp_path / "bad.json", out).stderr
    assert "expected a sum of 1" in wrenchflow("split", clean, out, "--train", 0.9).stderr
    (clean / "review.json").write_text('{"format": 1, "episodes": {"a.mcap": {"sha256": "", "lable": "failure"}}}')
    assert "is no review" in wrenchflow("review", clean).stderr
    (clean / "review.json").unlink()
    (clean / "quality.parquet").unlink()
    assert "has no quality.parquet" in wrenchflow("select", clean, out, "--where", "max_force > 1").stderr
    assert not out.exists()
