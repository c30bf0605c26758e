"""All windows of all episodes, resident in two tensors and gathered by index."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Float32, Int64
from torch import Tensor

from wrenchflow.errors import DatasetError


def window_rows(lengths: Sequence[int], *, n_obs_steps: int, horizon: int) -> Int64[np.ndarray, "windows horizon"]:
    """Rows of every window, in episodes that lie one after the other.

    Every step of every episode is the current step of one window, which starts `n_obs_steps - 1` steps before it. Where
    a window would leave its episode, it repeats the episode's first or last step. Its first `n_obs_steps` rows are the
    observations, and all are the actions.

    Args:
        lengths: Steps of each episode.
        n_obs_steps: Observation steps, the current one last.
        horizon: Actions, from the oldest observation step on.
    """
    count = np.asarray(lengths, dtype=np.int64)
    stop = np.cumsum(count)
    current = np.arange(count.sum())
    rows = current[:, None] - (n_obs_steps - 1) + np.arange(horizon)
    return np.clip(rows, np.repeat(stop - count, count)[:, None], np.repeat(stop - 1, count)[:, None])


@dataclass(frozen=True, eq=False)
class Windows:
    """Training windows, held in memory.

    Attributes:
        features: Of all steps of all episodes. Shape (n, width).
        actions: Of the same steps, encoded. Shape (n, 9).
        rows: Of every window. Shape (windows, horizon).
        n_obs_steps: How many of a window's rows are observations.
    """

    features: Float[Tensor, "n width"]
    actions: Float[Tensor, "n action"]
    rows: Int64[Tensor, "windows horizon"]
    n_obs_steps: int

    def __len__(self) -> int:
        return len(self.rows)

    def take(
        self, index: Int64[Tensor, " B"]
    ) -> tuple[Float[Tensor, "B n_obs_steps width"], Float[Tensor, "B horizon action"]]:
        """Features and actions of the windows at `index`."""
        rows = self.rows[index]
        return self.features[rows[:, : self.n_obs_steps]], self.actions[rows]

    def draw(
        self, batch_size: int, generator: torch.Generator
    ) -> tuple[Float[Tensor, "B n_obs_steps width"], Float[Tensor, "B horizon action"]]:
        """Features and actions of windows drawn evenly, with replacement."""
        return self.take(torch.randint(len(self), (batch_size,), generator=generator))


def make_windows(
    features: Sequence[Float32[np.ndarray, "_ width"]],
    actions: Sequence[Float32[np.ndarray, "_ action"]],
    *,
    n_obs_steps: int,
    horizon: int,
) -> Windows:
    """Windows over episodes.

    Args:
        features: One array an episode.
        actions: One array an episode, as long as its features.
        n_obs_steps: Observation steps, the current one last.
        horizon: Actions, from the oldest observation step on.

    Raises:
        DatasetError: If there is no step, or features and actions of an episode differ in length.
    """
    lengths = [len(episode) for episode in features]
    if lengths != [len(episode) for episode in actions]:
        raise DatasetError("features and actions differ in episodes or steps; expected one action a step.")
    if not sum(lengths):
        raise DatasetError("there are no steps to make windows of.")
    rows = window_rows(lengths, n_obs_steps=n_obs_steps, horizon=horizon)
    return Windows(
        torch.from_numpy(np.concatenate(features)),
        torch.from_numpy(np.concatenate(actions)),
        torch.from_numpy(rows),
        n_obs_steps,
    )
