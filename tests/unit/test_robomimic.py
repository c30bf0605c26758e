"""robomimic's rules for its files, and what nobody checks but our reader."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from wrenchflow.datasets import robomimic, robomimic_reader
from wrenchflow.datasets.about import About
from wrenchflow.datasets.config import ExportConfig
from wrenchflow.datasets.increments import increments
from wrenchflow.datasets.keys import KEYS
from wrenchflow.errors import DatasetError
from wrenchflow.observation import OBSERVATIONS, Steps


def steps_of(*lengths: int) -> list[Steps]:
    rng = np.random.default_rng(len(lengths))
    return [
        Steps(
            episode_id=f"{i:04d}",
            t=np.arange(n, dtype=np.int64) * 50_000_000,
            period_ns=50_000_000,
            observations={name: rng.normal(size=(n, *s)).astype(np.float32) for name, s in OBSERVATIONS.items()},
            actions=rng.normal(0.0, 2.0, (n, 9)).astype(np.float32),
            success=i != 1,
            task="peg-insertion",
            operator="expert" if i % 2 else "novice",
            skew_ns={"wrench": np.arange(n)},
            valid={"wrench": np.arange(n) != 2},
        )
        for i, n in enumerate(lengths)
    ]


@pytest.fixture
def path(tmp_path) -> Path:
    robomimic.write(
        tmp_path / "d.hdf5", steps_of(*[4] * 12), About(config=ExportConfig(valid_fraction=0.25, next_obs=True))
    )
    return tmp_path / "d.hdf5"


def test_the_file_keeps_the_rules_of_robomimic(path):
    steps = steps_of(*[4] * 12)
    with h5py.File(path) as file:
        data = file["data"]
        env = json.loads(data.attrs["env_args"])
        assert env["env_name"] == "peg-insertion"
        assert env["env_kwargs"] == {}
        assert set(env) == {"env_name", "type", "env_version", "env_kwargs"}
        assert data.attrs["total"] == sum(demo.attrs["num_samples"] for demo in data.values()) == 48
        assert sorted(data, key=lambda name: int(name[5:])) == [f"demo_{i}" for i in range(12)]
        for i, one in enumerate(steps):
            demo = data[f"demo_{i}"]
            assert demo["actions"].shape == (4, 6)
            made = increments(one.observations["tcp_pose"], one.actions)
            np.testing.assert_array_equal(demo["actions"] * data.attrs["action_scale"], made)
            np.testing.assert_array_equal(demo["actions_abs"], one.actions)
            np.testing.assert_array_equal(demo["skew_ns"], [[0], [1], [2], [3]])
            np.testing.assert_array_equal(demo["valid"], [[1], [1], [0], [1]])
            assert np.abs(demo["actions"]).max() <= 1.0
            np.testing.assert_array_equal(demo["rewards"], [0, 0, 0, one.success])
            np.testing.assert_array_equal(demo["dones"], [0, 0, 0, 1])
            np.testing.assert_array_equal(demo["t_ns"], one.t)
            assert set(demo["obs"]) == set(demo["next_obs"]) == {key.name for key in KEYS}
            for key in KEYS:
                obs, following = demo["obs"][key.name][()], demo["next_obs"][key.name][()]
                assert obs.shape == (4, *key.shape)
                np.testing.assert_array_equal(following[:-1], obs[1:])
                np.testing.assert_array_equal(following[-1], obs[-1])
            pose = one.observations["tcp_pose"]
            np.testing.assert_array_equal(demo["obs/ee_pos"], pose[:, :3])
            np.testing.assert_array_equal(demo["obs/ee_quat"], pose[:, [4, 5, 6, 3]])  # xyzw, as robosuite has it.
            np.testing.assert_array_equal(demo["obs/force_window"], one.observations["wrench_window"])
        members = {name: [member.decode() for member in of] for name, of in file["mask"].items()}
        assert len(members["valid"]) == 3
        assert sorted(members["train"] + members["valid"]) == sorted(data)
        assert members["operator_expert"] == [f"demo_{i}" for i in range(1, 12, 2)]
        assert set(members["operator_expert_valid"]) == set(members["operator_expert"]) & set(members["valid"])
        assert set(members["task_peg-insertion_train"]) == set(members["train"])
        described = json.loads(data.attrs["about"])["observations"]
        assert described["ee_quat"]["columns"] == ["qx", "qy", "qz", "qw"]
        assert described["force_torque"]["units"] == ["N"] * 3 + ["N.m"] * 3
        assert described["force_torque"]["method"] == "latest"
        assert described["force_torque"]["causal"]
        assert not described["ee_pos"]["causal"]
        assert data.attrs["rate_hz"] == "20/1"


finite = st.floats(-(2.0**20), 2.0**20, width=32, allow_subnormal=False).filter(lambda x: x == 0 or abs(x) > 1e-30)


@given(actions=hnp.arrays(np.float32, st.tuples(st.integers(1, 5), st.just(6)), elements=finite))
def test_scaling_of_actions_is_exact_and_no_more_than_needed(actions):
    scale = robomimic.action_scale(np.abs(actions).max(axis=0))
    scaled = actions / scale
    assert (np.abs(scaled) <= 1.0).all()
    assert (scaled * scale).tobytes() == actions.tobytes()
    largest = np.abs(actions).max(axis=0)
    assert (np.frexp(scale)[0] == 0.5).all()  # Powers of two.
    for part in (slice(3), slice(3, 6)):
        assert len(set(scale[part])) == 1  # Directions stay what they are.
        assert largest[part].max() > scale[part][0] / 2 or not largest[part].any()


def replace_array(demo, name, change):
    values = change(demo[name][()])
    del demo[name]
    demo[name] = values


def poison(values):
    values = values.copy()
    values.reshape(-1)[-1] = np.nan
    return values


FAULTS = {
    r"demo_2: obs/force_torque: the value of step 3 is not finite": lambda f: replace_array(
        f["data/demo_2"], "obs/force_torque", poison
    ),
    r"demo_2: next_obs/ee_pos: the value of step 3 is not finite": lambda f: replace_array(
        f["data/demo_2"], "next_obs/ee_pos", poison
    ),
    r"demo_2: actions: the value of step 3 is not finite": lambda f: replace_array(f["data/demo_2"], "actions", poison),
    r"num_samples is 4, but 'obs/ee_pos' has shape \(3, 3\)": lambda f: replace_array(
        f["data/demo_2"], "obs/ee_pos", lambda values: values[:3]
    ),
    r"num_samples is 9, but 'rewards' has shape \(4,\)": lambda f: f["data/demo_2"].attrs.modify("num_samples", 9),
    r"obs/force_window: expected float32 of shape \(4, 50, 6\), got float32 of shape \(4, 49, 6\)": lambda f: (
        replace_array(f["data/demo_2"], "obs/force_window", lambda values: values[:, 1:])
    ),
    r"'obs/goal_pos' is missing\. There is: ee_pos, ee_quat": lambda f: f.__delitem__("data/demo_2/obs/goal_pos"),
    r"'actions' is missing\. There is: actions_abs, dones, next_obs, obs, rewards, skew_ns, t_ns, valid": lambda f: (
        f.__delitem__("data/demo_2/actions")
    ),
    r"attribute 'num_samples' is missing\. It has: episode_id, operator, recording_id, success, task": lambda f: f[
        "data/demo_2"
    ].attrs.__delitem__("num_samples"),
    r"attribute 'num_samples' cannot be 'four'": lambda f: f["data/demo_2"].attrs.__setitem__("num_samples", "four"),
    r"actions lie outside \[-1, 1\]": lambda f: replace_array(f["data/demo_2"], "actions", lambda values: values * 9),
    r"actions differ from what actions_abs and ee_pos make": lambda f: replace_array(
        f["data/demo_2"], "actions_abs", lambda values: values[::-1]
    ),
    r"valid is int64 of shape \(4, 1\), expected uint8": lambda f: replace_array(
        f["data/demo_2"], "valid", lambda values: values.astype(np.int64)
    ),
    r"t_ns has to be int64 and to increase": lambda f: replace_array(
        f["data/demo_2"], "t_ns", lambda values: values[::-1]
    ),
    r"says total = 47, but its episodes have 48 samples": lambda f: f["data"].attrs.modify("total", 47),
    r"/data holds 'episode', expected names of the form demo_0": lambda f: f.move("data/demo_2", "data/episode"),
    r"mask 'valid' names 'demo_99'": lambda f: replace_array(f, "mask/valid", lambda _: np.array([b"demo_99"])),
    r"action_scale: expected float32 of shape \(6,\)": lambda f: f["data"].attrs.__delitem__("action_scale"),
    r"has format 1; this wrenchflow reads format 2: export it anew": lambda f: f["data"].attrs.modify(
        "wrenchflow_format", 1
    ),
    r"is not a robomimic file of wrenchflow: .* got mask": lambda f: f.__delitem__("data"),
}


@pytest.mark.parametrize("message", list(FAULTS))
def test_a_file_with_a_fault_is_refused(path, message):
    with h5py.File(path, "r+") as file:
        FAULTS[message](file)
    with pytest.raises(DatasetError, match=message):
        robomimic_reader.read(path)
