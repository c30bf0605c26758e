"""The replay buffer, the flat tables, and the way back: every column equal to that of the other formats."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import zarr
from pyarrow import csv

from wrenchflow.datasets import increments
from wrenchflow.datasets.keys import ACTION_COLUMNS, to_keys
from wrenchflow.datasets.load import load_steps
from wrenchflow.datasets.restore import joined, restore, to_episode
from wrenchflow.errors import DatasetError
from wrenchflow.recording.reader import read_episode


@pytest.fixture(scope="module")
def exported(chain, wrenchflow):
    said = wrenchflow(
        "export", "zarr,parquet,csv", chain.folder / "clean", chain.folder / "more", "--jobs", 1, "--json"
    )
    assert said.result["episodes"] == 6
    assert (said.result["divided_by_gaps"], said.result["marked_steps"]) == ({}, 0)
    return chain.folder / "more"


@pytest.fixture(scope="module")
def steps(chain):
    return load_steps(chain.folder / "dataset" / "robomimic.hdf5")


def test_a_replay_buffer_is_cut_as_diffusion_policy_does(exported, steps):
    root = zarr.open_group(str(exported / "replay_buffer.zarr"), mode="r")
    assert root.metadata.zarr_format == 2
    data, ends = root["data"], root["meta"]["episode_ends"][:]
    assert ends.dtype == np.int64
    assert set(root.group_keys()) == {"data", "meta"}
    for name, array in data.arrays():
        assert array.shape[0] == ends[-1], name
    starts = [0, *ends[:-1]]
    for one, start, stop in zip(steps, starts, ends, strict=True):
        expected = to_keys(one.observations)
        expected |= {"action": one.actions, "time_ns": one.t, "timestamp": (one.t - one.t[0]) * 1e-9}
        expected["action_increment"] = increments.increments(one.observations["tcp_pose"], one.actions)
        expected["sync_skew_ns"] = np.stack(list(one.skew_ns.values()), axis=1)
        expected["sync_valid"] = np.stack(list(one.valid.values()), axis=1)
        assert set(expected) == {name for name, _ in data.arrays()}
        for name, values in expected.items():
            np.testing.assert_array_equal(data[name][start:stop], values, strict=True, err_msg=name)
    told = root.attrs["episodes"]
    assert [one["episode_id"] for one in told] == [one.episode_id for one in steps]
    assert sorted(root.attrs["masks"]["train"] + root.attrs["masks"]["valid"]) == list(range(6))


def test_a_row_of_the_table_is_a_step(exported, steps):
    table = pq.read_table(exported / "steps.parquet")
    assert len(table) == sum(map(len, steps))
    for name, columns, of in (
        ("force_torque.fz [N]", None, [one.observations["wrench"][:, 2] for one in steps]),
        ("ee_quat.qw [1]", None, [one.observations["tcp_pose"][:, 3] for one in steps]),
        ("skew.wrench [ns]", None, [one.skew_ns["wrench"] for one in steps]),
        ("time_ns", None, [one.t for one in steps]),
        *(
            (f"action.{column} [{'m' if i < 3 else '1'}]", None, [one.actions[:, i] for one in steps])
            for i, column in enumerate(ACTION_COLUMNS)
        ),
    ):
        assert columns is None
        np.testing.assert_array_equal(table[name].to_numpy(), np.concatenate(of), err_msg=name)
    read = csv.read_csv(exported / "steps.csv")
    assert read.column_names == table.column_names
    for name in table.column_names:
        if pa.types.is_floating(table[name].type):
            np.testing.assert_array_equal(read[name].to_numpy().astype(np.float32), table[name].to_numpy().astype("f4"))
        else:
            assert read[name].to_pylist() == table[name].to_pylist(), name
    said = json.loads((exported / "steps.csv.json").read_text())
    assert said["observations"]["force_torque"]["causal"] is True


def test_the_same_recordings_give_the_same_bytes(exported, chain, wrenchflow, tmp_path):
    wrenchflow("export", "zarr,parquet,csv", chain.folder / "clean", tmp_path / "again", "--jobs", 2)
    for path in sorted(exported.rglob("*")):
        if path.is_file():
            assert path.read_bytes() == (tmp_path / "again" / path.relative_to(exported)).read_bytes(), path


@pytest.mark.parametrize("kind", ["robomimic.hdf5", "lerobot"])
def test_a_data_set_comes_back_as_recordings(kind, chain, wrenchflow, steps, tmp_path):
    out = tmp_path / "restored"
    assert wrenchflow("restore", chain.folder / "dataset" / kind, out, "--json").result["recordings"] == 6
    for one in steps:
        restored = read_episode(out / f"{one.recording_id}.mcap")
        original = read_episode(chain.folder / "clean" / f"{one.recording_id}.mcap")
        assert (restored.task, restored.meta["operator"]) == (original.task, original.meta["operator"])
        assert restored.meta["result"]["success"] == original.meta["result"]["success"]
        np.testing.assert_array_equal(restored["tcp_pose"].t, one.t)
        np.testing.assert_array_equal(restored["tcp_pose"].data, one.observations["tcp_pose"])
        np.testing.assert_array_equal(restored["joint_states"].data[:, :7], one.observations["joint_position"])
        # The force comes back sample for sample, in single precision.
        wrench = restored["wrench"]
        rows = np.searchsorted(original["wrench"].t, wrench.t)
        np.testing.assert_array_equal(original["wrench"].t[rows], wrench.t)
        np.testing.assert_array_equal(original["wrench"].data[rows].astype(np.float32), wrench.data)
        assert len(wrench) > 45 * len(one)
        target = original["target_pose"]
        held = np.searchsorted(target.t, restored["target_pose"].t, side="right") - 1
        np.testing.assert_allclose(restored["target_pose"].data[:, :3], target.data[held, :3], atol=1e-6)
        turned = (restored["target_pose"].data[:, 3:] * target.data[held, 3:]).sum(axis=1)
        np.testing.assert_allclose(np.abs(turned), 1.0, atol=1e-6)
        assert (restored["target_pose"].data[:, 4] > 0.0).all()


def test_what_comes_back_is_sampled_to_the_same_steps(steps):
    from wrenchflow.observation import actions, observe

    one = steps[0]
    streams = to_episode(one).streams
    again = observe(streams, one.t, ["tcp_pose", "joint_position", "goal_pose", "wrench", "wrench_window"])
    for name, values in again.items():
        np.testing.assert_array_equal(values, one.observations[name], err_msg=name)
    t_next = np.append(one.t[1:], one.t[-1] + one.period_ns)
    np.testing.assert_allclose(actions(streams, one.t, t_next), one.actions, atol=1e-6)


def test_parts_of_a_recording_come_back_as_one(steps):
    from wrenchflow.datasets.parts import _cut

    one = steps[0]
    parts = [_cut(one, slice(20, None), ".1"), _cut(one, slice(0, 15), ".0")]
    ((id, found),) = joined(parts).items()
    assert id == one.recording_id
    restored = restore(found)
    assert restored.id == one.recording_id
    np.testing.assert_array_equal(restored["tcp_pose"].t, np.concatenate([one.t[:15], one.t[20:]]))


def test_windows_that_contradict_each_other_are_refused(steps):
    with pytest.raises(DatasetError, match=r"was not sampled every 2 ms"):
        to_episode(steps[0], sample_ns=2_000_000)
