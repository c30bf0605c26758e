"""A moving average of weights: steadier than the last ones, and the ones that are deployed."""

import copy

import torch
from torch import Tensor, nn


class Ema[M: nn.Module]:
    """Exponential moving average whose memory grows with the number of updates.

    After n updates, average <- decay * average + (1 - decay) * weights with decay = min(1 - n ** -power, max_decay).

    Attributes:
        average: A copy of the module, with averaged weights.
    """

    def __init__(self, module: M, power: float, max_decay: float) -> None:
        self.average: M = copy.deepcopy(module).requires_grad_(False).eval()
        self._power = power
        self._max_decay = max_decay
        self._updates = 0
        self._weights: list[Tensor] = [*module.parameters()]
        self._averages: list[Tensor] = [*self.average.parameters()]

    @torch.no_grad()
    def update(self) -> None:
        """Take in the module's present weights."""
        self._updates += 1
        decay = min(1.0 - self._updates**-self._power, self._max_decay)
        # One call for all tensors. It is what torch's own optimisers use, but has no public name.
        torch._foreach_lerp_(self._averages, self._weights, 1.0 - decay)  # pyright: ignore[reportPrivateImportUsage]
