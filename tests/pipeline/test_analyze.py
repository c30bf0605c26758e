"""`analyze` as a person meets it: any data set, with what is wrong named, and nothing said that nobody measured."""

import json
import shutil

import h5py
import numpy as np
import pyarrow.parquet as pq
import pytest

from droid.tree import Faults, motion, touched, write_episode, write_tree
from wrenchflow.datasets.analysis.external_wrench import _MASSES_KG

FAULTS = {
    3: Faults(without_metadata=True),
    8: Faults(without_optional=True),
    12: Faults(copy_of=5),
    15: Faults(slow=12),
    17: Faults(skipped=7),
    18: Faults(not_finite=3),
    20: Faults(truncated=True),
}


@pytest.fixture(scope="module")
def tree(tmp_path_factory):
    return write_tree(tmp_path_factory.mktemp("droid") / "tree", 24, faults=FAULTS)


@pytest.fixture(scope="module")
def analysed(wrenchflow, tree, tmp_path_factory):
    out = tmp_path_factory.mktemp("analysed") / "out"
    ran = wrenchflow("analyze", tree, out, "--task", "insert a plug", "--jobs", 1, "--json")
    return out, ran.result


def rows(out, name):
    return pq.read_table(out / f"{name}.parquet").to_pylist()


def test_a_droid_tree_is_analysed_and_what_was_planted_is_found(analysed):
    out, said = analysed
    assert (said["episodes"], said["left_out"], said["labs"], said["near_duplicates"]) == (23, 1, 4, 1)
    assert said["findings"] == {"not-finite": 1, "late-steps": 1, "skipped-actions": 1}
    found = {row["kind"]: row for row in rows(out, "findings")}
    assert "000018" in found["not-finite"]["place"]
    assert found["not-finite"]["value"] == 3
    assert "000015" in found["late-steps"]["place"]
    assert (found["skipped-actions"]["value"], found["late-steps"]["value"]) == (7, 12)
    (left_out,) = rows(out, "left_out")
    assert "000020" in left_out["place"]
    assert "truncated" in left_out["reason"]
    (twins,) = rows(out, "duplicates")
    assert "000012" in twins["first"] + twins["second"]
    assert "000005" in twins["first"] + twins["second"]
    episodes = {row["place"].split("/")[-2][-6:]: row for row in rows(out, "episodes")}
    assert "metadata" in episodes["000003"]["missing"]
    assert (episodes["000003"]["lab"], episodes["000003"]["success"]) == ("TRI", True)
    assert "observation/robot_state/motor_torques_measured" in episodes["000008"]["missing"]
    assert episodes["000008"]["estimated_contact_rate"] is None


def test_no_force_is_claimed_that_nobody_measured(analysed):
    out, said = analysed
    assert said["felt"] == ["estimated_external_wrench", "joint_torque"]
    assert "contact_rate" not in said
    for row in rows(out, "episodes"):
        assert row["contact_rate"] is None
        assert row["peak_force_n"] is None
    tables = {row["table"] for row in rows(out, "axes")}
    assert tables == {"estimated_external_wrench", "joint_torque", "action", "timing"}
    page = (out / "analysis.html").read_text()
    assert "no force sensor" in page
    assert "no sensor measured it" in page


def test_ranges_are_those_of_the_files(analysed, tree):
    out, _ = analysed
    torques = []
    for path in sorted(tree.rglob("trajectory.h5")):
        if "000020" not in str(path) and "000008" not in str(path):
            with h5py.File(path) as file:
                torques.append(file["observation/robot_state/motor_torques_measured"][()])
    torque = np.concatenate(torques)
    for row in rows(out, "axes"):
        if (row["kind"], row["table"]) == ("all", "joint_torque"):
            values = torque[:, int(row["column"][-1]) - 1]
            values = values[np.isfinite(values)]
            assert (row["min"], row["max"], row["count"]) == (values.min(), values.max(), len(values))
            assert row["mean"] == pytest.approx(values.mean(), abs=1e-9)
            assert row["q50"] == pytest.approx(np.median(values), rel=0.011, abs=0.02)
    per_lab = [
        row
        for row in rows(out, "axes")
        if (row["kind"], row["table"], row["column"]) == ("lab", "joint_torque", "tau3")
    ]
    assert sum(row["count"] for row in per_lab) == np.isfinite(torque[:, 2]).sum()


def test_an_estimated_contact_is_where_it_was_planted(analysed):
    out, _ = analysed
    share = np.diff([touched(250).start, touched(250).stop])[0] / 250
    for row in rows(out, "episodes"):
        if row["estimated_contact_rate"] is not None and "000018" not in row["place"]:
            assert row["estimated_contact_rate"] == pytest.approx(share, abs=0.03)
            assert 12.0 < row["estimated_peak_force_n"] < 40.0


def test_relevance_names_the_plugs_that_succeeded(analysed):
    out, _ = analysed
    taken = (out / "relevant.txt").read_text().split("\n")[:-1]
    assert taken
    assert all("/success/" in place for place in taken)
    assert {int(place.split("/")[-2][-6:]) % 5 for place in taken} == {1}


def test_the_number_of_workers_changes_no_byte(analysed, wrenchflow, tree, tmp_path):
    again = wrenchflow("analyze", tree, tmp_path / "out", "--task", "insert a plug", "--jobs", 2, "--json")
    assert again.code == 0
    for path in sorted(analysed[0].iterdir()):
        assert path.read_bytes() == (tmp_path / "out" / path.name).read_bytes(), path.name


def test_both_exports_and_their_recordings_say_the_same(chain, wrenchflow, tmp_path):
    said = {}
    for name, path in (("hdf5", "dataset/robomimic.hdf5"), ("lerobot", "dataset/lerobot"), ("clean", "clean")):
        said[name] = wrenchflow("analyze", chain.folder / path, tmp_path / name, "--jobs", 1, "--json").result
    same = ("episodes", "left_out", "steps", "hours", "successes", "tasks", "collectors", "felt", "contact_rate")
    assert {key: said["hdf5"][key] for key in same} == {key: said["lerobot"][key] for key in same}
    for name in ("peak_force_n", "path_m", "duration_s", "idle_share"):
        ours, theirs = ([row[name] for row in rows(tmp_path / kind, "episodes")] for kind in ("hdf5", "lerobot"))
        if name != "idle_share":  # Actions are increments in one and targets in the other.
            assert ours == pytest.approx(theirs)
    assert said["clean"]["episodes"] == 6
    assert said["clean"]["felt"] == ["joint_torque", "wrench"]
    assert 0.0 < said["clean"]["contact_rate"] < 1.0


def test_a_foreign_robomimic_file_without_force_is_analysed(wrenchflow, tmp_path):
    path = tmp_path / "foreign.hdf5"
    rng = np.random.default_rng(1)
    with h5py.File(path, "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = json.dumps({"env_name": "Lift", "type": 1, "env_kwargs": {"control_freq": 20}})
        for i in range(11):
            demo = data.create_group(f"demo_{i}")
            demo["actions"] = rng.uniform(-1, 1, (50, 7))
            demo["rewards"] = np.arange(50) == 49
            demo["obs/robot0_eef_pos"] = rng.normal(0, 0.1, (50, 3))
            demo["obs/agentview_image"] = np.zeros((50, 4, 4, 3), np.uint8)
        data["demo_10/obs/robot0_joint_pos"] = np.zeros((49, 7))
    out = tmp_path / "out"
    said = wrenchflow("analyze", path, out, "--jobs", 1, "--json").result
    assert (said["episodes"], said["left_out"], said["successes"], said["felt"]) == (10, 1, 10, [])
    assert [row["place"] for row in rows(out, "episodes")] == [f"demo_{i}" for i in range(10)]
    assert rows(out, "left_out")[0]["place"] == "demo_10"
    assert rows(out, "episodes")[0]["duration_s"] == pytest.approx(49 / 20)
    assert "holds no force" in (out / "analysis.html").read_text()


def test_text_of_a_file_is_text_in_the_page(wrenchflow, tmp_path):
    folder = write_episode(tmp_path / "tree", 0, steps=40)
    (metadata,) = folder.glob("metadata_*.json")
    said = json.loads(metadata.read_text()) | {"current_task": "<script>alert(1)</script>", "user": "<b>"}
    metadata.write_text(json.dumps(said))
    assert wrenchflow("analyze", tmp_path / "tree", tmp_path / "out", "--task", "<i>", "--jobs", 1).code == 0
    page = (tmp_path / "out" / "analysis.html").read_text()
    assert "<script>alert" not in page
    assert "<i>" not in page


@pytest.mark.parametrize(
    ("made", "expected"),
    [
        ("nothing", "holds no data set that is known here: got nothing"),
        ("missing", "does not exist"),
        ("v2", "is a LeRobot v2.1 data set; wrenchflow reads v3.0"),
        ("cut", "no episode of"),
        ("text", "is a file of no known kind"),
        ("hdf5", "holds no /data"),
    ],
)
def test_what_is_no_data_set_is_refused_with_the_reason(made, expected, wrenchflow, tmp_path):
    path = tmp_path / "data"
    if made == "nothing":
        path.mkdir()
    elif made == "v2":
        (path / "meta").mkdir(parents=True)
        (path / "meta" / "info.json").write_text(json.dumps({"codebase_version": "v2.1", "fps": 20}))
    elif made == "cut":
        write_episode(path, 0, steps=30, faults=Faults(truncated=True))
    elif made == "text":
        path = tmp_path / "data.txt"
        path.write_text("hello")
    elif made == "hdf5":
        path = tmp_path / "data.hdf5"
        with h5py.File(path, "w") as file:
            file["other"] = 1
    ran = wrenchflow("analyze", path, tmp_path / "out", "--jobs", 1)
    assert ran.code == 1
    assert expected in ran.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("column", ["observation/robot_state/joint_positions", "action/cartesian_velocity"])
def test_a_column_of_another_length_leaves_the_episode_out(column, wrenchflow, tmp_path):
    tree = write_tree(tmp_path / "tree", 2, steps=40)
    first = sorted(tree.rglob("trajectory.h5"))[0]
    with h5py.File(first, "r+") as file:
        values = file[column][()]
        del file[column]
        file[column] = values[:-1]
    out = tmp_path / "out"
    said = wrenchflow("analyze", tree, out, "--jobs", 1, "--json").result
    assert (said["episodes"], said["left_out"]) == (1, 1)
    assert "has shape" in rows(out, "left_out")[0]["reason"]


def test_the_generators_motion_rests_first_and_has_weight_to_carry():
    q = motion(0, 100)
    assert np.ptp(q[:15], axis=0).max() == 0.0
    assert np.ptp(q, axis=0).min() > 0.05
    assert _MASSES_KG.sum() > 15.0


def test_an_interrupted_analysis_is_not_there(tree, tmp_path, monkeypatch):
    from wrenchflow.datasets.analysis.analyze import analyze
    from wrenchflow.datasets.analysis.config import AnalysisConfig
    from wrenchflow.datasets.analysis.open_source import open_source

    out = tmp_path / "out"
    looking = analyze(open_source(tree), tree, out, AnalysisConfig())
    next(looking)
    looking.close()
    assert not out.exists()
    shutil.rmtree(tmp_path / "out.partial")
