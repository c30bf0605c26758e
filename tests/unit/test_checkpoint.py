"""A policy on disk: comes back the same, and damage is told in one line."""

import dataclasses
import json

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file

from wrenchflow.errors import CheckpointError
from wrenchflow.force_filter import FilterConfig
from wrenchflow.observation import Steps
from wrenchflow.policy.checkpoint import load_policy, require_fit, save
from wrenchflow.policy.config import MlpConfig, PolicyConfig
from wrenchflow.policy.features import ACTION_COLUMNS, ACTION_FLOORS, Features
from wrenchflow.policy.learned import LearnedPolicy
from wrenchflow.policy.normaliser import fit_actions, fit_observations

FELT = FilterConfig(cutoff_hz=40.0, order=3, median_samples=5)


@pytest.fixture
def policy() -> LearnedPolicy:
    rng = np.random.default_rng(0)
    features = Features(("position", "wrench"))
    return LearnedPolicy(
        PolicyConfig(mlp=MlpConfig(width=16, layers=1, step_embedding=8), horizon=4),
        features,
        50_000_000,
        fit_observations(rng.normal(size=(50, 9)).astype(np.float32), features.columns, features.floors),
        fit_actions(rng.normal(size=(50, 9)).astype(np.float32), ACTION_COLUMNS, ACTION_FLOORS),
        FELT,
    ).eval()


@pytest.fixture
def run(policy, tmp_path):
    save(tmp_path, policy)
    return tmp_path


def edit(path, **changes):
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def test_a_policy_comes_back_the_same_bit_for_bit(policy, run, tmp_path):
    loaded = load_policy(run)
    assert loaded.config == policy.config
    assert loaded.features == policy.features
    assert loaded.period_ns == policy.period_ns
    assert loaded.wrench_filter == policy.wrench_filter == FELT
    observations = np.random.default_rng(1).normal(size=(2, 2, 9)).astype(np.float32)
    goal = np.array([[0.5, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0]] * 2)
    first, second = (p.act(observations, goal, [np.random.default_rng(i) for i in (0, 1)]) for p in (policy, loaded))
    np.testing.assert_array_equal(first, second)


def test_the_same_policy_gives_the_same_bytes(policy, run, tmp_path):
    again = tmp_path / "again"
    again.mkdir()
    save(again, load_policy(run))
    for name in ("policy.json", "weights.safetensors"):
        assert (again / name).read_bytes() == (run / name).read_bytes()


@pytest.mark.parametrize("name", ["policy.json", "weights.safetensors"])
def test_a_missing_file_is_named(run, name):
    (run / name).unlink()
    with pytest.raises(CheckpointError, match=f"it has no {name}. Expected"):
        load_policy(run)


@pytest.mark.parametrize("name", ["policy.json", "weights.safetensors"])
def test_a_truncated_file_is_told_in_one_line(run, name):
    whole = (run / name).read_bytes()
    (run / name).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(CheckpointError, match=name) as told:
        load_policy(run)
    assert "\n" not in str(told.value)


def test_weights_of_another_size_are_refused(run):
    described = json.loads((run / "policy.json").read_text())
    described["policy"]["mlp"]["width"] = 32
    edit(run / "policy.json", policy=described["policy"])
    with pytest.raises(CheckpointError, match=r"tensor 'layers\.0\.bias' is \(16,\), expected \(32,\)"):
        load_policy(run)


def test_weights_of_another_network_are_refused(run):
    described = json.loads((run / "policy.json").read_text())
    edit(run / "policy.json", policy=described["policy"] | {"network": "unet"})
    with pytest.raises(CheckpointError, match=r"is not there, expected|expected none of that name"):
        load_policy(run)


def test_weights_that_are_not_finite_are_refused(run):
    weights = load_file(run / "weights.safetensors")
    weights["layers.0.bias"] = torch.full_like(weights["layers.0.bias"], float("nan"))
    save_file(weights, run / "weights.safetensors")
    with pytest.raises(CheckpointError, match="not finite"):
        load_policy(run)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format_version": 99}, "has format version 99, expected 1"),
        ({"feature_groups": ["position", "wrnch"]}, "Did you mean 'wrench'"),
        ({"feature_groups": ["position"]}, "expected those of the features"),
        ({"policy": {"horizn": 8}}, "Did you mean 'horizon'"),
        ({"period_ns": None}, "does not describe a policy"),
        ({"observation_normaliser": {}}, "key 'columns' is missing"),
    ],
)
def test_a_description_that_is_wrong_says_what_is_wrong(run, changes, message):
    edit(run / "policy.json", **changes)
    with pytest.raises(CheckpointError, match=message):
        load_policy(run)


def test_data_that_lack_what_the_policy_sees_do_not_fit(policy):
    count = 3
    observations = {
        "tcp_pose": np.zeros((count, 7), np.float32),
        "wrench": np.zeros((count, 6), np.float32),
        "goal_pose": np.zeros((count, 7), np.float32),
    }
    steps = Steps(
        episode_id="0007",
        t=np.arange(count) * 50_000_000,
        period_ns=50_000_000,
        observations=observations,
        actions=np.zeros((count, 9), np.float32),
        wrench_filter=FELT,
    )
    require_fit(policy, [steps])
    blind = dataclasses.replace(steps, observations={k: v for k, v in observations.items() if k != "wrench"})
    with pytest.raises(CheckpointError, match=r"0007 lacks observation 'wrench'\. It has: tcp_pose, goal_pose"):
        require_fit(policy, [blind])
    with pytest.raises(CheckpointError, match="every 100000000 ns, expected every 50000000 ns"):
        require_fit(policy, [dataclasses.replace(steps, period_ns=100_000_000)])
    with pytest.raises(CheckpointError, match=r"wrench through .*cutoff_hz=20.*, expected through .*cutoff_hz=40"):
        require_fit(policy, [dataclasses.replace(steps, wrench_filter=FilterConfig(cutoff_hz=20.0))])
