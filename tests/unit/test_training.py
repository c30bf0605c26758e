"""Training: learns a rule that needs force, the same seed gives the same weights, and half a run never looks whole."""

import dataclasses
import json
import subprocess
import sys

import numpy as np
import pytest
import torch

from wrenchflow.datasets import robomimic
from wrenchflow.datasets.about import About
from wrenchflow.datasets.split import validation_ids
from wrenchflow.errors import CheckpointError, ConfigError, DatasetError, OutputError
from wrenchflow.force_filter import FilterConfig
from wrenchflow.observation import OBSERVATIONS, Steps
from wrenchflow.policy.checkpoint import load_policy
from wrenchflow.policy.config import DiffusionConfig, MlpConfig, PolicyConfig, UnetConfig
from wrenchflow.policy.learned import LearnedPolicy
from wrenchflow.train.config import TrainConfig
from wrenchflow.train.ema import Ema
from wrenchflow.train.loop import learning_rate, train_policy
from wrenchflow.train.run import train_folder

PERIOD_NS = 50_000_000
SMALL = TrainConfig(
    policy=PolicyConfig(
        mlp=MlpConfig(width=64, layers=2, step_embedding=16), horizon=2, diffusion=DiffusionConfig(inference_steps=8)
    ),
    steps=400,
    batch_size=64,
    learning_rate=5e-3,
    warmup_steps=50,
    metrics_every=200,
    valid_fraction=0.2,
    threads=1,
)
BRIEF = dataclasses.replace(SMALL, steps=6, metrics_every=3)


def felt_episode(index: int) -> Steps:
    """The tool is anywhere near the goal; the target is the goal, moved by 1 mm for each newton felt sideways."""
    rng = np.random.default_rng([3, index])
    count = 20
    observations = {name: np.zeros((count, *shape), np.float32) for name, shape in OBSERVATIONS.items()}
    observations["goal_pose"][:] = [0.5, 0.1, 0.2, 1.0, 0.0, 0.0, 0.0]
    observations["tcp_pose"][:] = observations["goal_pose"]
    observations["tcp_pose"][:, :3] += rng.uniform(-0.02, 0.02, size=(count, 3))
    observations["wrench"][:, :2] = rng.uniform(-5.0, 5.0, size=(count, 2))
    actions = np.zeros((count, 9), np.float32)
    actions[:, :3] = observations["goal_pose"][:, :3]
    actions[:, :2] += 1e-3 * observations["wrench"][:, :2]
    actions[:, [3, 7]] = 1.0
    return Steps(
        episode_id=f"{index:04d}",
        t=np.arange(count) * PERIOD_NS,
        period_ns=PERIOD_NS,
        observations=observations,
        actions=actions,
    )


@pytest.fixture(scope="module")
def steps() -> list[Steps]:
    return [felt_episode(index) for index in range(20)]


def trained(steps: list[Steps], config: TrainConfig, start: LearnedPolicy | None = None) -> LearnedPolicy:
    training = train_policy(steps, config, start)
    while True:
        try:
            next(training)
        except StopIteration as end:
            return end.value


def last_row(steps: list[Steps], config: TrainConfig):
    return [progress.metrics for progress in train_policy(steps, config)][-1]


@pytest.mark.parametrize(
    "policy",
    [
        SMALL.policy,
        dataclasses.replace(SMALL.policy, diffusion=DiffusionConfig(prediction="v_prediction")),
        dataclasses.replace(SMALL.policy, diffusion=DiffusionConfig(prediction="sample", eta=0.0)),
        dataclasses.replace(SMALL.policy, objective="regression"),
    ],
    ids=["diffusion", "velocity", "sample", "regression"],
)
def test_learns_a_rule_that_needs_force(steps, policy):
    config = dataclasses.replace(SMALL, policy=policy)
    # The best that a policy can do without the wrench is the mean action, which is this far off.
    mean_error_m = float(
        np.mean([np.linalg.norm(1e-3 * one.observations["wrench"][:, :2], axis=1).mean() for one in steps])
    )
    felt = last_row(steps, config).valid_position_error_m
    assert felt < 0.5 * mean_error_m


def test_the_u_net_learns_too(steps):
    unet = UnetConfig(widths=(16, 32), kernel=3, step_embedding=16)
    policy = dataclasses.replace(SMALL.policy, network="unet", unet=unet, objective="regression")
    config = dataclasses.replace(SMALL, policy=policy, steps=200, metrics_every=200)
    assert last_row(steps, config).valid_position_error_m < 2e-3


def test_without_force_the_rule_cannot_be_learned(steps):
    config = dataclasses.replace(
        SMALL, features="without_force", policy=dataclasses.replace(SMALL.policy, objective="regression")
    )
    assert last_row(steps, config).valid_position_error_m > 3e-3


def test_the_same_seed_gives_the_same_weights_whatever_was_drawn_before(steps):
    first = trained(steps, BRIEF)
    torch.rand(3)
    second = trained(steps, BRIEF)
    other = trained(steps, dataclasses.replace(BRIEF, seed=1))
    weights = [p.network.state_dict() for p in (first, second, other)]
    assert all(torch.equal(weights[0][name], weights[1][name]) for name in weights[0])
    assert not any(torch.equal(weights[0][name], weights[2][name]) for name in weights[0])


def test_training_leaves_torch_as_it_was(steps):
    before = torch.get_num_threads(), torch.get_rng_state()
    training = train_policy(steps, dataclasses.replace(BRIEF, threads=2 if before[0] == 1 else 1))
    next(training)
    training.close()
    assert torch.get_num_threads() == before[0]
    assert torch.equal(torch.get_rng_state(), before[1])


def test_the_normaliser_has_not_seen_held_out_episodes(steps):
    held_out = validation_ids([one.episode_id for one in steps], BRIEF.valid_fraction)
    far = [
        dataclasses.replace(one, actions=one.actions + np.float32(5.0)) if one.episode_id in held_out else one
        for one in steps
    ]
    assert held_out
    assert trained(far, BRIEF).actions.normaliser == trained(steps, BRIEF).actions.normaliser


def test_training_goes_on_from_another_policy_and_leaves_it_as_it_was(steps):
    start = trained(steps, dataclasses.replace(SMALL, steps=200))
    before = {name: value.clone() for name, value in start.network.state_dict().items()}
    brief = dataclasses.replace(BRIEF, learning_rate=1e-5, warmup_steps=0)
    on = [row.metrics for row in train_policy(steps, brief, start)][-1]
    anew = last_row(steps, brief)
    assert on.valid_position_error_m < 0.5 * anew.valid_position_error_m
    # The scales stay those that the weights were trained with, whatever the new episodes would say.
    moved = [dataclasses.replace(one, actions=one.actions * np.float32(1.5)) for one in steps]
    assert trained(moved, brief, start).actions.normaliser == start.actions.normaliser
    assert all(torch.equal(before[name], value) for name, value in start.network.state_dict().items())


def test_training_goes_on_only_from_a_policy_of_the_same_make(steps):
    start = trained(steps, BRIEF)
    wider = dataclasses.replace(BRIEF, policy=dataclasses.replace(BRIEF.policy, horizon=4))
    with pytest.raises(CheckpointError, match=r"its policy\.horizon is 2, expected 4"):
        trained(steps, wider, start)
    slower = [dataclasses.replace(one, t=2 * one.t, period_ns=2 * PERIOD_NS) for one in steps]
    with pytest.raises(CheckpointError, match="a step every 100000000 ns, expected every 50000000 ns"):
        trained(slower, BRIEF, start)


def test_rate_warms_up_and_ends_near_zero():
    rates = [learning_rate(step, SMALL) for step in range(SMALL.steps)]
    assert rates[0] < 0.05 * SMALL.learning_rate
    assert max(rates) == pytest.approx(SMALL.learning_rate, rel=0.05)
    assert rates[-1] < 1e-3 * SMALL.learning_rate


def test_the_average_forgets_where_it_started_and_follows():
    module = torch.nn.Linear(1, 1)
    ema = Ema(module, power=0.75, max_decay=0.9)
    torch.nn.init.constant_(module.weight, 3.0)
    ema.update()
    # The first update takes the weights as they are.
    assert ema.average.weight.item() == 3.0
    torch.nn.init.constant_(module.weight, 4.0)
    for _ in range(200):
        ema.update()
    assert ema.average.weight.item() == pytest.approx(4.0)
    assert module.weight.item() == 4.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda steps: [], "no episodes"),
        (lambda steps: [steps[0], dataclasses.replace(steps[1], period_ns=1)], "one period for all"),
        (
            lambda steps: [steps[0], dataclasses.replace(steps[1], wrench_filter=FilterConfig(order=2))],
            "one filter for all",
        ),
        (lambda steps: [dataclasses.replace(steps[0], observations={})], "0000 lacks observation 'tcp_pose'"),
        (
            lambda steps: [dataclasses.replace(steps[0], actions=np.full_like(steps[0].actions, np.nan))],
            "not finite in: target_x_m",
        ),
    ],
)
def test_data_that_cannot_be_trained_on_are_refused(steps, change, message):
    with pytest.raises(DatasetError, match=message):
        trained(change(steps), BRIEF)


def test_a_learning_rate_that_is_too_high_is_told(steps):
    config = dataclasses.replace(BRIEF, learning_rate=1e30, warmup_steps=0, valid_fraction=0.0)
    with pytest.raises(ConfigError, match=r"learning_rate is 1e\+30"):
        trained(steps, config)


@pytest.mark.parametrize("wrong", [{"steps": 0}, {"learning_rate": 0.0}, {"valid_fraction": 1.0}, {"seed": -1}])
def test_a_config_that_cannot_be_trained_is_refused(wrong):
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        TrainConfig(**wrong)


@pytest.fixture(scope="module")
def dataset(steps, tmp_path_factory):
    path = tmp_path_factory.mktemp("data") / "robomimic.hdf5"
    robomimic.write(path, steps, About())
    return path


def test_a_run_is_whole_and_the_same_seed_gives_the_same_bytes(dataset, tmp_path):
    for name in ("a", "b"):
        rows = list(train_folder(dataset, tmp_path / name, BRIEF))
        assert [progress.metrics.step for progress in rows] == [3, 6]
    names = {path.name for path in (tmp_path / "a").iterdir()}
    same = {"weights.safetensors", "policy.json", "config.json", "metrics.jsonl", "manifest.json"}
    assert names == same | {"timing.jsonl"}
    for name in same:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    written = [json.loads(line) for line in (tmp_path / "a" / "metrics.jsonl").read_text().splitlines()]
    assert [row["step"] for row in written] == [3, 6]
    assert load_policy(tmp_path / "a").config == BRIEF.policy


def test_a_run_that_is_broken_off_does_not_look_whole(dataset, tmp_path):
    training = train_folder(dataset, tmp_path / "run", BRIEF)
    next(training)
    with pytest.raises(KeyboardInterrupt):
        training.throw(KeyboardInterrupt())
    assert [path.name for path in tmp_path.iterdir()] == ["run.partial"]


def test_a_run_that_is_there_is_not_replaced_unless_told(dataset, tmp_path):
    list(train_folder(dataset, tmp_path / "run", BRIEF))
    with pytest.raises(OutputError, match="exists already"):
        next(train_folder(dataset, tmp_path / "run", BRIEF))
    list(train_folder(dataset, tmp_path / "run", dataclasses.replace(BRIEF, seed=1), overwrite=True))
    assert json.loads((tmp_path / "run" / "config.json").read_text())["seed"] == 1


def test_a_data_set_that_is_not_there_leaves_no_run(tmp_path):
    with pytest.raises(DatasetError, match="does not exist"):
        next(train_folder(tmp_path / "nothing", tmp_path / "run", BRIEF))
    assert not (tmp_path / "run").exists()


def test_configs_and_features_load_no_torch():
    code = (
        "import sys, wrenchflow.train.config, wrenchflow.policy.policy, wrenchflow.policy.normaliser;"
        "sys.exit('torch' in sys.modules or 'diffusers' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
