"""Two ways to learn a chunk of actions with one network: denoise it, or regress it. All values are normalised."""

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import torch
from diffusers.schedulers.scheduling_ddim import DDIMScheduler
from diffusers.schedulers.scheduling_ddpm import DDPMScheduler
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import mse_loss

from wrenchflow.policy.config import DiffusionConfig, PolicyConfig

Network = Callable[[Tensor, Tensor, Tensor], Tensor]  # (chunk, step, observations) -> chunk


@runtime_checkable
class Objective(Protocol):
    """How a network is trained, and how a chunk is drawn from it.

    Attributes:
        noise_draws: Standard normal chunks that one sample takes.
    """

    noise_draws: int

    def loss(
        self,
        network: Network,
        observations: Float[Tensor, "B n_obs_steps width"],
        actions: Float[Tensor, "B horizon action"],
        generator: torch.Generator,
    ) -> Float[Tensor, ""]:
        """Mean squared error over a batch, to be made small."""
        ...

    def sample(
        self,
        network: Network,
        observations: Float[Tensor, "B n_obs_steps width"],
        noise: Float[Tensor, "B noise_draws horizon action"],
    ) -> Float[Tensor, "B horizon action"]:
        """A chunk for each row, determined by the row's observations and noise."""
        ...


class Diffusion:
    """The network says what noise is in a noisy chunk; acting starts from noise alone and takes it away step by step.

    Sources: Ho et al., *Denoising Diffusion Probabilistic Models* (2020), eq. 14, for the loss; Song et al.,
    *Denoising Diffusion Implicit Models* (2021), eq. 12 and 16, for acting.
    """

    def __init__(self, config: DiffusionConfig) -> None:
        schedule: dict[str, Any] = {
            "num_train_timesteps": config.steps,
            "beta_schedule": "squaredcos_cap_v2",
            "prediction_type": config.prediction,
            "clip_sample": True,
        }
        self._training = DDPMScheduler(**schedule)
        self._acting = DDIMScheduler(**schedule)
        self._acting.set_timesteps(config.inference_steps)
        self._config = config
        self.noise_draws = 1 + config.inference_steps if config.eta > 0.0 else 1

    def loss(
        self,
        network: Network,
        observations: Float[Tensor, "B n_obs_steps width"],
        actions: Float[Tensor, "B horizon action"],
        generator: torch.Generator,
    ) -> Float[Tensor, ""]:
        """Mean squared error of the prediction, at noise levels and with noise drawn from `generator`."""
        noise = torch.randn(actions.shape, generator=generator)
        # The scheduler's annotations ask for 32 bit integers; it takes any.
        step: Any = torch.randint(self._config.steps, (len(actions),), generator=generator)
        noisy = self._training.add_noise(actions, noise, step)
        predicted = network(noisy, step, observations)
        match self._config.prediction:
            case "epsilon":
                return mse_loss(predicted, noise)
            case "sample":
                return mse_loss(predicted, actions)
            case "v_prediction":
                return mse_loss(predicted, self._training.get_velocity(actions, noise, step))

    def sample(
        self,
        network: Network,
        observations: Float[Tensor, "B n_obs_steps width"],
        noise: Float[Tensor, "B noise_draws horizon action"],
    ) -> Float[Tensor, "B horizon action"]:
        """Denoise the first draw, in a few steps; with fresh noise, each step takes one more draw."""
        chunk = noise[:, 0]
        for i, step in enumerate(self._acting.timesteps):
            predicted = network(chunk, step.expand(len(chunk)), observations)
            fresh = noise[:, 1 + i] if self.noise_draws > 1 else None
            chunk = self._acting.step(
                predicted, int(step), chunk, eta=self._config.eta, variance_noise=fresh, return_dict=False
            )[0]
        return chunk


class Regression:
    """The network says the chunk itself: the baseline that diffusion has to beat, on the same network."""

    noise_draws = 1

    def loss(
        self,
        network: Network,
        observations: Float[Tensor, "B n_obs_steps width"],
        actions: Float[Tensor, "B horizon action"],
        generator: torch.Generator,
    ) -> Float[Tensor, ""]:
        """Mean squared error of the chunk; nothing is drawn."""
        return mse_loss(self.sample(network, observations, actions[:, None]), actions)

    def sample(
        self,
        network: Network,
        observations: Float[Tensor, "B n_obs_steps width"],
        noise: Float[Tensor, "B noise_draws horizon action"],
    ) -> Float[Tensor, "B horizon action"]:
        """The one chunk for each row. Only the shape of the noise is used: the network sees zeros in its place."""
        return network(torch.zeros_like(noise[:, 0]), torch.zeros(len(noise), dtype=torch.int64), observations)


def make_objective(config: PolicyConfig) -> Objective:
    """The objective that a config asks for."""
    if config.objective == "diffusion":
        return Diffusion(config.diffusion)
    return Regression()
