"""A policy made of a network, an objective and two normalisers: features in, target poses out."""

from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor, nn

from wrenchflow.errors import CheckpointError
from wrenchflow.force_filter import FilterConfig
from wrenchflow.observation import ACTION_WIDTH
from wrenchflow.policy.config import PolicyConfig
from wrenchflow.policy.diffusion import make_objective
from wrenchflow.policy.features import Features, decode_actions
from wrenchflow.policy.networks import make_network
from wrenchflow.policy.normaliser import Normaliser


class Scaling(nn.Module):
    """A `Normaliser` on tensors."""

    center: Tensor
    scale: Tensor

    def __init__(self, normaliser: Normaliser) -> None:
        super().__init__()
        self.normaliser = normaliser
        # Not persistent: the normaliser is stored where a person can read it, beside the weights.
        self.register_buffer("center", torch.tensor(normaliser.center, dtype=torch.float32), persistent=False)
        self.register_buffer("scale", torch.tensor(normaliser.scale, dtype=torch.float32), persistent=False)

    def forward(self, values: Float[Tensor, "*n d"]) -> Float[Tensor, "*n d"]:
        """Normalise, and hold within the bound where there is one."""
        scaled = (values - self.center) / self.scale
        bound = self.normaliser.bound
        return scaled if bound is None else scaled.clamp(-bound, bound)

    def undo(self, scaled: Float[Tensor, "*n d"]) -> Float[Tensor, "*n d"]:
        """Back to physical units."""
        return scaled * self.scale + self.center


class LearnedPolicy(nn.Module):
    """Predicts a chunk of targets in the goal's frame from features; a `policy.Policy`.

    Attributes:
        config: What it is made of.
        features: What it sees.
        period_ns: Time between steps [ns], as in its training data.
        wrench_filter: What the wrench of its training data went through.
        observations: Normalises features.
        actions: Normalises encoded actions.
        network: The weights.
    """

    def __init__(
        self,
        config: PolicyConfig,
        features: Features,
        period_ns: int,
        observation_normaliser: Normaliser,
        action_normaliser: Normaliser,
        wrench_filter: FilterConfig | None = None,
    ) -> None:
        super().__init__()
        if observation_normaliser.columns != features.columns:
            raise CheckpointError(
                f"the normaliser's columns are {', '.join(observation_normaliser.columns)}, "
                f"expected those of the features: {', '.join(features.columns)}."
            )
        if len(action_normaliser.columns) != ACTION_WIDTH:
            raise CheckpointError(
                f"the action normaliser has {len(action_normaliser.columns)} columns, expected {ACTION_WIDTH}."
            )
        self.config = config
        self.features = features
        self.period_ns = period_ns
        self.wrench_filter = wrench_filter or FilterConfig()
        self.observations = Scaling(observation_normaliser)
        self.actions = Scaling(action_normaliser)
        self.network = make_network(config, action_width=ACTION_WIDTH, feature_width=features.width)
        self._objective = make_objective(config)

    @property
    def n_obs_steps(self) -> int:
        """Steps that it sees, the current one last."""
        return self.config.n_obs_steps

    @property
    def horizon(self) -> int:
        """Targets that `act` gives: the chunk without the actions of past observation steps."""
        return self.config.horizon - self.config.n_obs_steps + 1

    @property
    def n_action_steps(self) -> int:
        """Targets to execute before it should be asked again."""
        return self.config.n_action_steps

    @property
    def noise_draws(self) -> int:
        """Standard normal chunks that one prediction takes."""
        return self._objective.noise_draws

    def loss(
        self,
        observations: Float[Tensor, "B n_obs_steps width"],
        actions: Float[Tensor, "B horizon 9"],
        generator: torch.Generator,
    ) -> Float[Tensor, ""]:
        """Training loss of a batch of features and encoded actions."""
        return self._objective.loss(self.network, self.observations(observations), self.actions(actions), generator)

    def predict(
        self, observations: Float[Tensor, "B n_obs_steps width"], noise: Float[Tensor, "B noise_draws horizon 9"]
    ) -> Float[Tensor, "B horizon 9"]:
        """Encoded actions of the whole chunk, past observation steps included.

        Args:
            observations: Features. Shape (B, n_obs_steps, width).
            noise: From a standard normal distribution. Shape (B, noise_draws, horizon, 9).
        """
        return self.actions.undo(self._objective.sample(self.network, self.observations(observations), noise))

    @torch.inference_mode()
    def act(
        self,
        observations: Float32[np.ndarray, "B n_obs_steps width"],
        goal_pose: Float[np.ndarray, "B 7"],
        rngs: Sequence[np.random.Generator],
    ) -> Float[np.ndarray, "B horizon 7"]:
        """Where to go; see `policy.Policy.act`."""
        shape = (self.noise_draws, self.config.horizon, ACTION_WIDTH)
        noise = np.stack([rng.standard_normal(shape, dtype=np.float32) for rng in rngs])
        chunk = self.predict(torch.from_numpy(observations), torch.from_numpy(noise)).numpy()
        return decode_actions(chunk[:, self.config.n_obs_steps - 1 :], goal_pose[:, None])
