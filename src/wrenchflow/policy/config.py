"""What a learned policy is made of. Free of torch, so that the command line can show it without loading a network."""

from dataclasses import dataclass, field
from typing import Literal

from wrenchflow.errors import ConfigError

Objective = Literal["diffusion", "regression"]
NetworkName = Literal["mlp", "unet"]
Prediction = Literal["epsilon", "v_prediction", "sample"]


@dataclass(frozen=True, kw_only=True)
class MlpConfig:
    """Size of the multilayer perceptron, the default on a CPU.

    Attributes:
        width: Units of each hidden layer.
        layers: Hidden layers.
        step_embedding: Width of the denoising step's embedding.
    """

    width: int = 512
    layers: int = 3
    step_embedding: int = 64

    def __post_init__(self) -> None:
        _require_positive("mlp", width=self.width, layers=self.layers, step_embedding=self.step_embedding)
        _require_even("mlp.step_embedding", self.step_embedding)


@dataclass(frozen=True, kw_only=True)
class UnetConfig:
    """Size of the one-dimensional U-Net, which convolves along the chunk and is modulated by the observations.

    Attributes:
        widths: Channels of each level; each level after the first works on half as many steps.
        kernel: Width of the convolutions [steps], odd.
        groups: Groups of the group normalisation; they divide every width.
        step_embedding: Width of the denoising step's embedding.
    """

    widths: tuple[int, ...] = (64, 128)
    kernel: int = 5
    groups: int = 8
    step_embedding: int = 64

    def __post_init__(self) -> None:
        _require_positive("unet", kernel=self.kernel, groups=self.groups, step_embedding=self.step_embedding)
        _require_even("unet.step_embedding", self.step_embedding)
        if not self.widths or any(width < 1 or width % self.groups for width in self.widths):
            raise ConfigError(
                f"unet.widths are {self.widths}, expected at least one, each a multiple of {self.groups}."
            )
        if self.kernel % 2 == 0:
            raise ConfigError(f"unet.kernel is {self.kernel}, expected an odd number of steps.")


@dataclass(frozen=True, kw_only=True)
class DiffusionConfig:
    """How chunks are made noisy in training, and denoised when acting.

    Attributes:
        steps: Noise levels in training.
        inference_steps: Denoising steps when acting.
        prediction: What the network says about a noisy chunk: the noise, the chunk, or the velocity between them. The
            chunk has half the error of the noise after the same training on peg insertion.
        eta: Fresh noise in each denoising step: 0 is DDIM's deterministic path, 1 as much as DDPM. Fresh noise makes
            the chunk forget the errors of earlier steps.
    """

    steps: int = 100
    inference_steps: int = 8
    prediction: Prediction = "sample"
    eta: float = 1.0

    def __post_init__(self) -> None:
        _require_positive("diffusion", inference_steps=self.inference_steps)
        if self.inference_steps > self.steps:
            raise ConfigError(
                f"diffusion.inference_steps is {self.inference_steps}, expected at most diffusion.steps = {self.steps}."
            )
        if not 0.0 <= self.eta <= 1.0:
            raise ConfigError(f"diffusion.eta is {self.eta}, expected from 0 to 1.")


@dataclass(frozen=True, kw_only=True)
class PolicyConfig:
    """A policy that predicts a chunk of actions from the last few observations.

    The chunk starts at the oldest observation: of its `horizon` actions, number `n_obs_steps - 1` is the action of the
    current step.

    Attributes:
        n_obs_steps: Observation steps that the policy sees.
        horizon: Actions in a chunk.
        n_action_steps: Actions to execute before the next chunk is asked for.
        objective: Denoise the chunk, or regress it: the baseline on the same network.
        network: Which network.
        mlp: Its size, where `network` is `mlp`.
        unet: Its size, where `network` is `unet`.
        diffusion: Its noise, where `objective` is `diffusion`.
    """

    n_obs_steps: int = 2
    horizon: int = 8
    n_action_steps: int = 1
    objective: Objective = "diffusion"
    network: NetworkName = "mlp"
    mlp: MlpConfig = field(default_factory=MlpConfig)
    unet: UnetConfig = field(default_factory=UnetConfig)
    diffusion: DiffusionConfig = field(default_factory=DiffusionConfig)

    def __post_init__(self) -> None:
        _require_positive("policy", n_obs_steps=self.n_obs_steps, n_action_steps=self.n_action_steps)
        if self.horizon > _LONGEST_STEPS:
            raise ConfigError(f"horizon is {self.horizon} steps, expected at most {_LONGEST_STEPS}.")
        if self.horizon < self.n_obs_steps - 1 + self.n_action_steps:
            raise ConfigError(
                f"horizon is {self.horizon} steps, too short to hold {self.n_obs_steps} observation steps and "
                f"{self.n_action_steps} action steps; expected at least {self.n_obs_steps - 1 + self.n_action_steps}."
            )
        halvings = 2 ** (len(self.unet.widths) - 1)
        if self.network == "unet" and self.horizon % halvings:
            raise ConfigError(
                f"horizon is {self.horizon} steps, expected a multiple of {halvings} for a U-Net of "
                f"{len(self.unet.widths)} levels."
            )


_LONGEST_STEPS = 1024


def _require_positive(where: str, **values: int) -> None:
    for name, value in values.items():
        if value < 1:
            raise ConfigError(f"{where}.{name} is {value}, expected at least 1.")


def _require_even(where: str, value: int) -> None:
    if value % 2:
        raise ConfigError(f"{where} is {value}, expected an even number: half of it are sines, half cosines.")
