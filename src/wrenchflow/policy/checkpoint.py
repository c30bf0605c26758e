"""A trained policy on disk: `weights.safetensors` beside `policy.json`, which a person can read."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from wrenchflow.config import from_mapping, to_mapping
from wrenchflow.errors import CheckpointError, WrenchflowError
from wrenchflow.force_filter import FilterConfig
from wrenchflow.manifest import read_json, write_json
from wrenchflow.observation import Steps
from wrenchflow.policy.config import PolicyConfig
from wrenchflow.policy.features import Features
from wrenchflow.policy.learned import LearnedPolicy
from wrenchflow.policy.normaliser import Normaliser

WEIGHTS = "weights.safetensors"
DESCRIPTION = "policy.json"
FORMAT_VERSION = 1


def save(folder: Path, policy: LearnedPolicy) -> None:
    """Write a policy into a folder that exists."""
    save_file(policy.network.state_dict(), folder / WEIGHTS)
    write_json(
        folder / DESCRIPTION,
        {
            "format_version": FORMAT_VERSION,
            "feature_groups": to_mapping(policy.features.groups),
            "period_ns": policy.period_ns,
            "wrench_filter": to_mapping(policy.wrench_filter),
            "policy": to_mapping(policy.config),
            "observation_normaliser": to_mapping(policy.observations.normaliser),
            "action_normaliser": to_mapping(policy.actions.normaliser),
        },
    )


def load_policy(folder: Path) -> LearnedPolicy:
    """Read a policy, ready to act.

    Raises:
        CheckpointError: If a file is missing or damaged, of another format version, or does not fit the other one.
    """
    for name in (DESCRIPTION, WEIGHTS):
        if not (folder / name).is_file():
            raise CheckpointError(f"'{folder}' is not a run: it has no {name}. Expected: {DESCRIPTION}, {WEIGHTS}.")
    policy = _described(folder)
    try:
        weights = load_file(folder / WEIGHTS)
    except (SafetensorError, OSError) as error:
        raise CheckpointError(f"'{folder / WEIGHTS}' cannot be read: {error}") from error
    expected = {name: tuple(value.shape) for name, value in policy.network.state_dict().items()}
    got = {name: tuple(value.shape) for name, value in weights.items()}
    if got != expected:
        name = min(name for name in expected.keys() | got.keys() if expected.get(name) != got.get(name))
        raise CheckpointError(
            f"'{folder / WEIGHTS}' does not fit {DESCRIPTION}: tensor '{name}' is {got.get(name, 'not there')}, "
            f"expected {expected.get(name, 'none of that name')}."
        )
    if not all(bool(torch.isfinite(value).all()) for value in weights.values()):
        raise CheckpointError(f"'{folder / WEIGHTS}' holds weights that are not finite.")
    policy.network.load_state_dict(weights)
    return policy.eval().requires_grad_(False)


def _described(folder: Path) -> LearnedPolicy:
    """The policy that `policy.json` describes, with weights still to be loaded."""
    path = folder / DESCRIPTION
    try:
        described: dict[str, Any] = read_json(path)
        if described["format_version"] != FORMAT_VERSION:
            raise CheckpointError(
                f"'{path}' has format version {described['format_version']}, expected {FORMAT_VERSION}."
            )
        return LearnedPolicy(
            from_mapping(PolicyConfig, described["policy"], "policy"),
            Features(tuple(described["feature_groups"])),
            int(described["period_ns"]),
            from_mapping(Normaliser, described["observation_normaliser"], "observation_normaliser"),
            from_mapping(Normaliser, described["action_normaliser"], "action_normaliser"),
            # Without it, as it was before it could be set.
            from_mapping(FilterConfig, described.get("wrench_filter", {}), "wrench_filter"),
        )
    except CheckpointError:
        raise
    except (WrenchflowError, KeyError, TypeError, ValueError) as error:
        what = f"key {error} is missing" if isinstance(error, KeyError) else str(error)
        raise CheckpointError(f"'{path}' does not describe a policy: {what}") from error


def require_fit(policy: LearnedPolicy, steps: Sequence[Steps]) -> None:
    """Refuse a data set that a policy was not made for.

    Raises:
        CheckpointError: If an observation that the policy sees is missing, the steps are of another period, or the
            wrench went through another filter.
    """
    for episode in steps:
        for name in policy.features.observation_names:
            if name not in episode.observations:
                raise CheckpointError(
                    f"the checkpoint does not fit the data: episode {episode.episode_id} lacks observation '{name}'. "
                    f"It has: {', '.join(episode.observations) or 'none'}."
                )
        if episode.period_ns != policy.period_ns:
            raise CheckpointError(
                f"the checkpoint does not fit the data: episode {episode.episode_id} has a step every "
                f"{episode.period_ns} ns, expected every {policy.period_ns} ns."
            )
        if episode.wrench_filter != policy.wrench_filter:
            raise CheckpointError(
                f"the checkpoint does not fit the data: episode {episode.episode_id} has a wrench through "
                f"{episode.wrench_filter}, expected through {policy.wrench_filter}."
            )
