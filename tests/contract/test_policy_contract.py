"""Rules that every policy keeps, whatever it is made of."""

import dataclasses

import numpy as np
import pytest
import torch

from wrenchflow.policy.config import DiffusionConfig, MlpConfig, PolicyConfig, UnetConfig
from wrenchflow.policy.features import ACTION_COLUMNS, ACTION_FLOORS, WITH_FORCE, Features
from wrenchflow.policy.learned import LearnedPolicy
from wrenchflow.policy.normaliser import fit_actions, fit_observations
from wrenchflow.policy.policy import Policy, WithoutForceInput
from wrenchflow.spatial import exp_so3, make_pose

SMALL = PolicyConfig(mlp=MlpConfig(width=16, layers=2, step_embedding=8), diffusion=DiffusionConfig(inference_steps=4))


def learned(config: PolicyConfig) -> LearnedPolicy:
    rng = np.random.default_rng(0)
    features = Features(WITH_FORCE)
    torch.manual_seed(0)
    return LearnedPolicy(
        config,
        features,
        50_000_000,
        fit_observations(rng.normal(size=(50, features.width)), features.columns, features.floors),
        fit_actions(rng.normal(size=(50, 9)), ACTION_COLUMNS, ACTION_FLOORS),
    ).eval()


POLICIES = {
    "diffusion": lambda: learned(SMALL),
    "one path": lambda: learned(dataclasses.replace(SMALL, diffusion=DiffusionConfig(inference_steps=4, eta=0.0))),
    "velocity": lambda: learned(dataclasses.replace(SMALL, diffusion=DiffusionConfig(prediction="v_prediction"))),
    "regression": lambda: learned(dataclasses.replace(SMALL, objective="regression")),
    "u-net": lambda: learned(
        dataclasses.replace(SMALL, network="unet", unet=UnetConfig(widths=(8, 16), step_embedding=8))
    ),
    "more steps": lambda: learned(dataclasses.replace(SMALL, n_obs_steps=3, n_action_steps=4)),
    "without force input": lambda: WithoutForceInput(learned(SMALL)),
}


@pytest.fixture(params=POLICIES.values(), ids=POLICIES.keys())
def policy(request) -> Policy:
    return request.param()


def seen_by(policy: Policy, count: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(1)
    observations = rng.normal(size=(count, policy.n_obs_steps, policy.features.width)).astype(np.float32)
    return observations, make_pose(rng.normal(size=(count, 3)), exp_so3(rng.normal(size=(count, 3)) * 0.3))


def rngs(count: int) -> list[np.random.Generator]:
    return [np.random.default_rng([7, i]) for i in range(count)]


def test_gives_as_many_poses_as_it_says(policy):
    targets = policy.act(*seen_by(policy, 3), rngs(3))
    assert targets.shape == (3, policy.horizon, 7)
    assert policy.horizon >= policy.n_action_steps >= 1
    assert policy.period_ns == 50_000_000
    np.testing.assert_allclose(np.linalg.norm(targets[..., 3:], axis=-1), 1.0)


def test_the_same_randomness_gives_the_same_targets(policy):
    first, second = (policy.act(*seen_by(policy, 2), rngs(2)) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_a_robot_does_not_depend_on_its_neighbours(policy):
    observations, goal = seen_by(policy, 4)
    together = policy.act(observations, goal, rngs(4))
    alone = policy.act(observations[2:3], goal[2:3], rngs(4)[2:3])
    # A matrix product may add in another order for another number of rows; nothing more may differ.
    np.testing.assert_allclose(alone[0], together[2], atol=1e-4)


def test_targets_move_with_the_goal(policy):
    observations, goal = seen_by(policy, 2)
    moved = goal + np.array([0.1, 0.2, 0.3, 0.0, 0.0, 0.0, 0.0])
    difference = policy.act(observations, moved, rngs(2)) - policy.act(observations, goal, rngs(2))
    np.testing.assert_allclose(difference[..., :3], np.broadcast_to([0.1, 0.2, 0.3], difference[..., :3].shape))


def test_what_is_seen_is_left_alone(policy):
    observations, goal = seen_by(policy, 2)
    before = observations.copy(), goal.copy()
    policy.act(observations, goal, rngs(2))
    np.testing.assert_array_equal(observations, before[0])
    np.testing.assert_array_equal(goal, before[1])


def test_without_force_input_only_the_wrench_is_hidden():
    felt = learned(SMALL)
    unfelt = WithoutForceInput(felt)
    observations, goal = seen_by(felt, 2)
    pushed, moved = observations.copy(), observations.copy()
    pushed[..., felt.features.columns.index("force_x_n")] += 1.0
    pushed[..., felt.features.columns.index("mean_torque_z_nm")] += 1.0
    moved[..., felt.features.columns.index("position_x_m")] += 1.0
    assert not np.array_equal(felt.act(pushed, goal, rngs(2)), felt.act(observations, goal, rngs(2)))
    np.testing.assert_array_equal(unfelt.act(pushed, goal, rngs(2)), unfelt.act(observations, goal, rngs(2)))
    assert not np.array_equal(unfelt.act(moved, goal, rngs(2)), unfelt.act(observations, goal, rngs(2)))
