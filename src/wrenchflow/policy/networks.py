"""Networks that map a noisy chunk of actions, a denoising step and the observations to a chunk of the same shape."""

import math
from itertools import pairwise

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

from wrenchflow.policy.config import MlpConfig, PolicyConfig, UnetConfig


class StepEmbedding(nn.Module):
    """Sines and cosines of the denoising step, at frequencies from 1 to 1/10000, looked up in a table.

    Source: Vaswani et al., *Attention Is All You Need* (2017), section 3.5.
    """

    table: Tensor

    def __init__(self, steps: int, width: int) -> None:
        super().__init__()
        frequency = torch.exp(-math.log(10_000.0) * torch.arange(width // 2) / max(width // 2 - 1, 1))
        angle = torch.arange(steps)[:, None] * frequency
        self.register_buffer("table", torch.cat([angle.sin(), angle.cos()], dim=1), persistent=False)

    def forward(self, step: Int64[Tensor, " B"]) -> Float[Tensor, "B width"]:
        """Embed the steps."""
        return self.table[step]


class Mlp(nn.Module):
    """Chunk, observations and step embedding in one row, through equal hidden layers."""

    def __init__(
        self, config: MlpConfig, *, horizon: int, action_width: int, observation_width: int, steps: int
    ) -> None:
        super().__init__()
        self.embedding = StepEmbedding(steps, config.step_embedding)
        chunk = horizon * action_width
        widths = [chunk + observation_width + config.step_embedding] + [config.width] * config.layers
        layers: list[nn.Module] = []
        for before, after in pairwise(widths):
            layers += [nn.Linear(before, after), nn.SiLU()]
        self.layers = nn.Sequential(*layers, nn.Linear(config.width, chunk))

    def forward(
        self,
        chunk: Float[Tensor, "B horizon action"],
        step: Int64[Tensor, " B"],
        observations: Float[Tensor, "B n_obs_steps width"],
    ) -> Float[Tensor, "B horizon action"]:
        """One denoising (or regression) step."""
        row = torch.cat([chunk.flatten(1), observations.flatten(1), self.embedding(step)], dim=1)
        return self.layers(row).view_as(chunk)


class ConvBlock(nn.Sequential):
    """Convolution along the steps of the chunk, group normalisation, Mish."""

    def __init__(self, before: int, after: int, kernel: int, groups: int) -> None:
        super().__init__(nn.Conv1d(before, after, kernel, padding=kernel // 2), nn.GroupNorm(groups, after), nn.Mish())


class FilmBlock(nn.Module):
    """Two convolutions with a skip; the condition scales and shifts the channels between them.

    Source: Perez et al., *FiLM: Visual Reasoning with a General Conditioning Layer* (2018), eq. 2.
    """

    def __init__(self, before: int, after: int, condition: int, kernel: int, groups: int) -> None:
        super().__init__()
        self.first = ConvBlock(before, after, kernel, groups)
        self.second = ConvBlock(after, after, kernel, groups)
        self.modulation = nn.Sequential(nn.Mish(), nn.Linear(condition, 2 * after))
        self.skip = nn.Conv1d(before, after, 1) if before != after else nn.Identity()

    def forward(
        self, x: Float[Tensor, "B before steps"], condition: Float[Tensor, "B condition"]
    ) -> Float[Tensor, "B after steps"]:
        """Transform the channels, given the condition."""
        scale, shift = self.modulation(condition)[:, :, None].chunk(2, dim=1)
        return self.second(self.first(x) * (1.0 + scale) + shift) + self.skip(x)


class Unet(nn.Module):
    """Convolutions along the chunk at ever coarser steps and back, conditioned on step and observations by FiLM.

    Source: Chi et al., *Diffusion Policy: Visuomotor Policy Learning via Action Diffusion* (2023), section 3.
    """

    def __init__(self, config: UnetConfig, *, action_width: int, observation_width: int, steps: int) -> None:
        super().__init__()
        embedding = config.step_embedding
        self.embedding = nn.Sequential(
            StepEmbedding(steps, embedding),
            nn.Linear(embedding, 4 * embedding),
            nn.Mish(),
            nn.Linear(4 * embedding, embedding),
        )
        condition = embedding + observation_width

        def block(before: int, after: int) -> FilmBlock:
            return FilmBlock(before, after, condition, config.kernel, config.groups)

        widths = config.widths
        before = (action_width, *widths[:-1])
        self.down = nn.ModuleList(
            nn.ModuleList([block(b, a), block(a, a)]) for b, a in zip(before, widths, strict=True)
        )
        self.coarsen = nn.ModuleList(nn.Conv1d(width, width, 3, stride=2, padding=1) for width in widths[:-1])
        self.middle = nn.ModuleList([block(widths[-1], widths[-1]), block(widths[-1], widths[-1])])
        # Each finer level takes the coarser one, brought to twice the steps, beside what went down at its own level.
        self.refine = nn.ModuleList(
            nn.ConvTranspose1d(a, b, 4, stride=2, padding=1) for b, a in reversed(list(pairwise(widths)))
        )
        self.up = nn.ModuleList(nn.ModuleList([block(2 * w, w), block(w, w)]) for w in reversed(widths[:-1]))
        self.out = nn.Sequential(
            ConvBlock(widths[0], widths[0], config.kernel, config.groups), nn.Conv1d(widths[0], action_width, 1)
        )

    def forward(
        self,
        chunk: Float[Tensor, "B horizon action"],
        step: Int64[Tensor, " B"],
        observations: Float[Tensor, "B n_obs_steps width"],
    ) -> Float[Tensor, "B horizon action"]:
        """One denoising (or regression) step."""
        condition = torch.cat([self.embedding(step), observations.flatten(1)], dim=1)
        x = chunk.transpose(1, 2)
        passed: list[Tensor] = []
        for level, blocks in enumerate(self.down):
            x = _through(blocks, x, condition)
            if level < len(self.coarsen):
                passed.append(x)
                x = self.coarsen[level](x)
        x = _through(self.middle, x, condition)
        for refine, blocks in zip(self.refine, self.up, strict=True):
            x = _through(blocks, torch.cat([refine(x), passed.pop()], dim=1), condition)
        return self.out(x).transpose(1, 2)


def _through(blocks: nn.Module, x: Tensor, condition: Tensor) -> Tensor:
    for block in blocks.children():
        x = block(x, condition)
    return x


def make_network(config: PolicyConfig, *, action_width: int, feature_width: int) -> nn.Module:
    """The network that a config asks for, with weights drawn from torch's global generator."""
    observation_width = config.n_obs_steps * feature_width
    if config.network == "mlp":
        return Mlp(
            config.mlp,
            horizon=config.horizon,
            action_width=action_width,
            observation_width=observation_width,
            steps=config.diffusion.steps,
        )
    return Unet(
        config.unet, action_width=action_width, observation_width=observation_width, steps=config.diffusion.steps
    )
