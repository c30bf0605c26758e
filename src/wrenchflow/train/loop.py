"""Trains a policy on the steps of episodes."""

import copy
import math
import time
from collections.abc import Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import torch

from wrenchflow.config import to_mapping
from wrenchflow.datasets.parts import valid_parts
from wrenchflow.datasets.split import validation_ids
from wrenchflow.errors import CheckpointError, ConfigError, DatasetError
from wrenchflow.observation import ACTION_WIDTH, Steps
from wrenchflow.policy.checkpoint import require_fit
from wrenchflow.policy.features import ACTION_COLUMNS, ACTION_FLOORS, PRESETS, Features, encode_actions
from wrenchflow.policy.learned import LearnedPolicy
from wrenchflow.policy.normaliser import fit_actions, fit_observations
from wrenchflow.train.config import TrainConfig
from wrenchflow.train.ema import Ema
from wrenchflow.train.windows import Windows, make_windows

_VALID_WINDOWS = 512  # Windows that the averaged weights are judged on.
_VALID_SEED = 0  # Their noise is the same at every judgement, so that rows can be compared.


@dataclass(frozen=True, kw_only=True)
class Metrics:
    """How the training stands: the same numbers for the same seed.

    Attributes:
        step: Updates done.
        learning_rate: At the last of them.
        loss: Mean over the updates since the last row.
        valid_loss: Of the averaged weights on held-out episodes; None without such episodes.
        valid_position_error_m: Mean distance between predicted and demonstrated target of the current step, on
            held-out episodes [m]; None without such episodes.
    """

    step: int
    learning_rate: float
    loss: float
    valid_loss: float | None
    valid_position_error_m: float | None


@dataclass(frozen=True, kw_only=True)
class Progress:
    """One row of metrics, and the time that the updates since the last row took.

    Attributes:
        metrics: How the training stands.
        steps: Updates to do in all.
        update_s: Time in forward, backward and optimiser [s].
        data_s: Time in drawing batches [s].
    """

    metrics: Metrics
    steps: int
    update_s: float
    data_s: float


def train_policy(
    steps: Sequence[Steps], config: TrainConfig, start: LearnedPolicy | None = None
) -> Generator[Progress, None, LearnedPolicy]:
    """Train a policy.

    Args:
        steps: One episode each, all of one period.
        config: How.
        start: A trained policy to go on from, with its weights and its normalisers; it stays as it is.

    Yields:
        A row of metrics now and then, and after the last update.

    Returns:
        The policy with averaged weights, ready to act.

    Raises:
        DatasetError: If there are no episodes, their periods differ, or one lacks what the policy sees.
        CheckpointError: If `start` does not fit the episodes, or is made of something else than `config` says.
        ConfigError: If the learning rate is so high that the loss overflows.
    """
    features = Features(PRESETS[config.features])
    steps = [part for episode in steps for part in valid_parts(episode)]
    period_ns = _require_usable(steps, features)
    if start is not None:
        require_fit(start, steps)
        _require_alike(start, config)
    held_out = validation_ids({episode.recording_id for episode in steps}, config.valid_fraction)
    seen = [features.encode(episode.observations) for episode in steps]
    done = [encode_actions(episode.actions, episode.observations["goal_pose"]) for episode in steps]

    def windows_of(episodes: Sequence[int]) -> Windows:
        return make_windows(
            [seen[i] for i in episodes],
            [done[i] for i in episodes],
            n_obs_steps=config.policy.n_obs_steps,
            horizon=config.policy.horizon,
        )

    train = [i for i, episode in enumerate(steps) if episode.recording_id not in held_out]
    valid = [i for i, episode in enumerate(steps) if episode.recording_id in held_out]
    with _threads(config.threads):
        windows = windows_of(train)
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(config.seed)
            policy = (
                copy.deepcopy(start).train().requires_grad_()
                if start is not None
                else LearnedPolicy(
                    config.policy,
                    features,
                    period_ns,
                    fit_observations(windows.features.numpy(), features.columns, features.floors),
                    fit_actions(windows.actions.numpy(), ACTION_COLUMNS, ACTION_FLOORS),
                    steps[0].wrench_filter,
                )
            )
        return (yield from _updates(policy, windows, windows_of(valid) if valid else None, config))


def _updates(
    policy: LearnedPolicy, windows: Windows, valid: Windows | None, config: TrainConfig
) -> Generator[Progress, None, LearnedPolicy]:
    generator = torch.Generator().manual_seed(config.seed)
    ema = Ema(policy, config.ema_power, config.ema_max_decay)
    optimiser = torch.optim.AdamW(
        policy.parameters(), config.learning_rate, betas=(0.95, 0.999), weight_decay=config.weight_decay, fused=True
    )
    losses: list[torch.Tensor] = []  # Read only where a row is due: reading one waits for it.
    update_s = data_s = 0.0
    for step in range(config.steps):
        start = time.perf_counter()
        observations, actions = windows.draw(config.batch_size, generator)
        drawn = time.perf_counter()
        optimiser.param_groups[0]["lr"] = learning_rate(step, config)
        optimiser.zero_grad()
        loss = policy.loss(observations, actions, generator)
        loss.backward()
        optimiser.step()
        ema.update()
        losses.append(loss.detach())
        data_s += drawn - start
        update_s += time.perf_counter() - drawn
        if (step + 1) % config.metrics_every == 0 or step + 1 == config.steps:
            valid_loss, valid_position_error_m = judge(ema.average, valid) if valid else (None, None)
            metrics = Metrics(
                step=step + 1,
                learning_rate=learning_rate(step, config),
                loss=float(torch.stack(losses).mean()),
                valid_loss=valid_loss,
                valid_position_error_m=valid_position_error_m,
            )
            if not math.isfinite(metrics.loss):
                raise ConfigError(
                    f"the loss is no longer finite at update {step + 1}: "
                    f"learning_rate is {config.learning_rate}, expected less."
                )
            yield Progress(metrics=metrics, steps=config.steps, update_s=update_s, data_s=data_s)
            losses.clear()
            update_s = data_s = 0.0
    return ema.average


def learning_rate(step: int, config: TrainConfig) -> float:
    """Rate of an update: a linear warm-up times a half cosine that ends at zero."""
    warm = min(1.0, (step + 1) / max(config.warmup_steps, 1))
    return config.learning_rate * warm * 0.5 * (1.0 + math.cos(math.pi * step / config.steps))


@torch.inference_mode()
def judge(policy: LearnedPolicy, windows: Windows) -> tuple[float, float]:
    """Loss, and mean distance [m] between predicted and demonstrated current target, on windows spread evenly."""
    generator = torch.Generator().manual_seed(_VALID_SEED)
    index = torch.linspace(0, len(windows) - 1, min(len(windows), _VALID_WINDOWS)).long()
    observations, actions = windows.take(index)
    loss = policy.loss(observations, actions, generator)
    noise = torch.randn(len(index), policy.noise_draws, *actions.shape[1:], generator=generator)
    chunk = policy.predict(observations, noise)
    now = policy.n_obs_steps - 1
    return float(loss), float((chunk - actions)[:, now, :3].norm(dim=-1).mean())


def _require_usable(steps: Sequence[Steps], features: Features) -> int:
    """The period [ns] of episodes that can be trained on together."""
    if not steps:
        raise DatasetError("the data set has no episodes to train on.")
    for episode in steps:
        features.require(episode.observations, f"episode {episode.episode_id}")
        if episode.actions.shape[1] != ACTION_WIDTH:
            raise DatasetError(
                f"episode {episode.episode_id} has actions of width {episode.actions.shape[1]}, "
                f"expected {ACTION_WIDTH}."
            )
    periods_ns = sorted({episode.period_ns for episode in steps})
    if len(periods_ns) > 1:
        raise DatasetError(f"episodes have steps every {periods_ns} ns, expected one period for all.")
    if any(episode.wrench_filter != steps[0].wrench_filter for episode in steps):
        raise DatasetError("episodes have wrenches through different filters, expected one filter for all.")
    return periods_ns[0]


def _require_alike(start: LearnedPolicy, config: TrainConfig) -> None:
    groups = PRESETS[config.features]
    if start.features.groups != groups:
        raise CheckpointError(
            f"the checkpoint sees {', '.join(start.features.groups)}, "
            f"expected what features '{config.features}' is: {', '.join(groups)}."
        )
    if start.config != config.policy:
        got, expected = to_mapping(start.config), to_mapping(config.policy)
        name = next(name for name in expected if got[name] != expected[name])
        raise CheckpointError(
            f"the checkpoint does not fit the config: its policy.{name} is {got[name]}, expected {expected[name]}."
        )


@contextmanager
def _threads(count: int) -> Iterator[None]:
    """Let torch use a number of threads, and put back the old number."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
