"""`validate` of data sets: what is planted is named with file, episode, column and row; what is whole passes."""

import json
import shutil

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import zarr


@pytest.fixture(scope="module")
def whole(chain, wrenchflow, tmp_path_factory):
    out = tmp_path_factory.mktemp("whole") / "data"
    arguments = ("--jobs", 1, "--valid-fraction", 0.3, "--next-obs")
    assert wrenchflow("export", "robomimic,lerobot,zarr", chain.folder / "clean", out, *arguments).code == 0
    return out


@pytest.fixture
def copy(whole, tmp_path):
    return shutil.copytree(whole, tmp_path / "data")


def problems(wrenchflow, path):
    ran = wrenchflow("validate", path, "--json")
    found = json.loads(ran.stdout)
    assert ran.code == (0 if found["valid"] else 1)
    assert found["valid"] == (not found["problems"])
    return found["problems"]


def test_what_export_writes_is_valid(whole, wrenchflow):
    ran = wrenchflow("validate", whole)
    assert (ran.code, ran.stdout.strip()) == (0, "valid: lerobot, replay_buffer.zarr, robomimic.hdf5")


def nan(file):
    file["data/demo_2/obs/force_torque"][7, 3] = np.nan


def short(file):
    demo = file["data/demo_1"]
    values = demo["obs/joint_pos"][()]
    del demo["obs/joint_pos"]
    demo["obs/joint_pos"] = values[:-2]


def beyond(file):
    file["data/demo_0/actions"][4, 2] = -1.5


def longer(file):
    file["data/demo_3"].attrs["num_samples"] = file["data/demo_3"].attrs["num_samples"] + 1


def total(file):
    file["data"].attrs["total"] = 5


def stamps(file):
    t = file["data/demo_2/t_ns"]
    t[9] = t[8]


def scaled(file):
    file["data"].attrs["action_scale"] = 2.0 * file["data"].attrs["action_scale"]


def quaternion(file):
    file["data/demo_5/obs/ee_quat"][3] *= 1.1


def leak(file):
    del file["mask/valid"]
    file["mask/valid"] = np.array([file["mask/train"][0]])


def recording_on_both_sides(file):
    train, valid = (file[f"mask/{name}"][0].decode() for name in ("train", "valid"))
    file[f"data/{valid}"].attrs["recording_id"] = file[f"data/{train}"].attrs["recording_id"]


def copied(file):
    train, valid = (file[f"mask/{name}"][0].decode() for name in ("train", "valid"))
    attributes = dict(file[f"data/{valid}"].attrs)
    del file[f"data/{valid}"]
    file.copy(f"data/{train}", f"data/{valid}")
    file[f"data/{valid}"].attrs["recording_id"] = attributes["recording_id"]


def unknown_member(file):
    del file["mask/train"]
    file["mask/train"] = np.array([b"demo_77"])


def following(file):
    file["data/demo_0/next_obs/ee_pos"][2] += 1.0


def no_environment(file):
    del file["data"].attrs["env_args"]


@pytest.mark.parametrize(
    ("plant", "expected"),
    [
        (nan, "robomimic.hdf5: demo_2: obs/force_torque: row 7: the value is nan"),
        (short, "robomimic.hdf5: demo_1: obs/joint_pos: has shape"),
        (beyond, "robomimic.hdf5: demo_0: actions: row 4: 1.5 is outside [-1, 1]"),
        (longer, "robomimic.hdf5: demo_3: actions: has shape"),
        (total, "robomimic.hdf5: /data: total is 5, but episodes have"),
        (stamps, "robomimic.hdf5: demo_2: t_ns: row 9:"),
        (scaled, "actions: row "),
        (quaternion, "robomimic.hdf5: demo_5: obs/ee_quat: row 3: a quaternion of norm 1.1"),
        (leak, "is in both train and valid"),
        (recording_on_both_sides, "is in valid and of the same recording as"),
        (copied, "is in valid and of the same numbers as"),
        (unknown_member, "mask/train: names demo_77, which is not there"),
        (following, "robomimic.hdf5: demo_0: next_obs/ee_pos: row 2: is not the observation of the step that follows"),
        (no_environment, "robomimic.hdf5: /data: attribute env_args is missing"),
    ],
)
def test_a_fault_of_a_robomimic_file_is_named(plant, expected, copy, wrenchflow):
    with h5py.File(copy / "robomimic.hdf5", "r+") as file:
        plant(file)
    assert any(expected in problem for problem in problems(wrenchflow, copy / "robomimic.hdf5"))


def rewritten(path, change):
    table = pq.read_table(path)
    pq.write_table(change(table), path)


def replaced(table, name, row, value):
    values = table[name].to_pylist()
    values[row] = value(values[row])
    at = table.column_names.index(name)
    return table.set_column(at, table.schema.field(name), pa.array(values, table.schema.field(name).type))


@pytest.mark.parametrize(
    ("name", "row", "value", "expected"),
    [
        ("observation.state", 5, lambda old: [float("nan")] + old[1:], "observation.state: row 5: the value is nan"),
        ("frame_index", 3, lambda old: old + 1, "frame_index: row 3: is 4, expected 3"),
        ("timestamp", 3, lambda old: old + 0.1, "timestamp: row 3:"),
        ("index", 3, lambda old: old + 1, "index: row 3:"),
        ("episode_index", 3, lambda old: 4, "does not hold the"),
        ("task_index", 3, lambda old: 9, "task_index: names task 9, there are 1"),
        ("observation.time_ns", 3, lambda old: old - 10**9, "observation.time_ns: row 3:"),
        ("action", 3, lambda old: [100.0] + old[1:], "stats.json: action.max: is"),
    ],
)
def test_a_fault_in_the_rows_of_a_lerobot_folder_is_named(name, row, value, expected, copy, wrenchflow):
    path = copy / "lerobot" / "data" / "chunk-000" / "file-000.parquet"
    rewritten(path, lambda table: replaced(table, name, row, value))
    found = problems(wrenchflow, copy / "lerobot")
    assert any(expected in problem and problem.startswith("lerobot: ") for problem in found), found


def test_a_fault_in_the_small_files_of_a_lerobot_folder_is_named(copy, wrenchflow):
    meta = copy / "lerobot" / "meta"
    info = json.loads((meta / "info.json").read_text())
    (meta / "info.json").write_text(json.dumps(info | {"total_frames": 7}))
    assert any("info.json: total_frames: is 7" in one for one in problems(wrenchflow, copy / "lerobot"))
    (meta / "info.json").write_text(json.dumps(info | {"codebase_version": "v2.1"}))
    ran = wrenchflow("validate", copy / "lerobot")
    assert (ran.code, "is a LeRobot v2.1 data set" in ran.stderr) == (1, True)
    (meta / "info.json").write_text(json.dumps(info))
    ours = json.loads((meta / "wrenchflow.json").read_text())
    ours["masks"]["valid"] = ours["masks"]["train"][:1]
    (meta / "wrenchflow.json").write_text(json.dumps(ours))
    assert any("is in both train and valid" in one for one in problems(wrenchflow, copy / "lerobot"))
    (copy / "lerobot" / "data" / "chunk-000" / "file-000.parquet").unlink()
    assert problems(wrenchflow, copy / "lerobot")


def test_a_fault_of_a_replay_buffer_is_named(copy, wrenchflow):
    root = zarr.open_group(str(copy / "replay_buffer.zarr"), mode="r+")
    ends = root["meta"]["episode_ends"][:]
    root["data"]["force_torque"][int(ends[0]) + 4, 1] = np.inf
    expected = "replay_buffer.zarr: episode 1: data/force_torque: row 4: the value is inf"
    assert any(expected in one for one in problems(wrenchflow, copy / "replay_buffer.zarr"))
    root["meta"]["episode_ends"][-1] = ends[-1] + 1
    assert any("the episodes end at" in one for one in problems(wrenchflow, copy / "replay_buffer.zarr"))


@pytest.mark.parametrize("name", ["robomimic.hdf5", "lerobot", "replay_buffer.zarr"])
def test_what_is_half_written_is_never_valid(name, copy, wrenchflow):
    (copy / name).rename(copy / f"{name}.partial")
    for path in (copy, copy / f"{name}.partial"):
        assert any("was not finished" in one for one in problems(wrenchflow, path))


def test_a_file_that_is_cut_off_is_refused(copy, wrenchflow):
    path = copy / "robomimic.hdf5"
    path.write_bytes(path.read_bytes()[:10_000])
    ran = wrenchflow("validate", path)
    assert (ran.code, "cannot be read as HDF5" in ran.stderr) == (1, True)
    assert "holds no data set" in wrenchflow("validate", copy.parent / "data" / "lerobot" / "data").stderr


def test_many_faults_of_a_kind_are_counted(copy, wrenchflow):
    with h5py.File(copy / "robomimic.hdf5", "r+") as file:
        for demo in file["data"].values():
            for column in ("obs/ee_pos", "obs/joint_pos", "obs/joint_vel"):
                demo[column][0] = np.inf
    found = problems(wrenchflow, copy / "robomimic.hdf5")
    assert sum("the value is inf" in one for one in found) == 10
    assert any("8 more of the kind not-finite" in one for one in found)
