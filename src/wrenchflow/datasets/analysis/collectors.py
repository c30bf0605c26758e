"""How far people who collect differ: for one task, the spread between them against the spread of each."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchflow.datasets.analysis.figures import EpisodeFigures

COMPARED = ("duration_s", "path_m", "peak_force_n", "estimated_peak_force_n", "contact_rate", "estimated_contact_rate")
_LEAST = 3  # Episodes of a collector: the spread of two says nothing.


@dataclass(frozen=True, kw_only=True)
class Spread:
    """A figure of one task, by collector.

    Attributes:
        task: The task.
        figure: The figure.
        collectors: How many there are with three episodes or more.
        episodes: How many episodes they have.
        between: Standard deviation between collectors, less what chance alone would make of it.
        within: Standard deviation of one collector's episodes, pooled.
        means: Mean of each collector, by name.
    """

    task: str
    figure: str
    collectors: int
    episodes: int
    between: float
    within: float
    means: dict[str, float]

    @property
    def ratio(self) -> float:
        """Between by within; inf where each collector repeats himself exactly."""
        return self.between / self.within if self.within > 0.0 else float("inf" if self.between > 0.0 else "nan")


def spreads(episodes: Sequence[EpisodeFigures]) -> tuple[Spread, ...]:
    """All that can be told, the largest ratio first.

    Variances come from a one-way analysis of variance with collectors of unequal numbers of episodes (Searle, Casella
    and McCulloch, Variance Components, 1992).
    """
    values: dict[tuple[str, str], dict[str, list[float]]] = {}
    for episode in episodes:
        task, collector = episode.labels.task, episode.labels.collector
        for figure in COMPARED:
            value = episode.values.get(figure)
            if task and collector and value is not None:
                values.setdefault((task, figure), {}).setdefault(collector, []).append(float(value))
    found = [_spread(task, figure, by) for (task, figure), by in values.items()]
    return tuple(sorted((each for each in found if each), key=lambda each: -np.nan_to_num(each.ratio)))


def _spread(task: str, figure: str, by: dict[str, list[float]]) -> Spread | None:
    groups = {name: np.array(each) for name, each in sorted(by.items()) if len(each) >= _LEAST}
    if len(groups) < 2:
        return None
    sizes = np.array([len(each) for each in groups.values()])
    means = np.array([each.mean() for each in groups.values()])
    total = int(sizes.sum())
    within = sum(((each - each.mean()) ** 2).sum() for each in groups.values()) / (total - len(groups))
    middle = (sizes * means).sum() / total
    between = (sizes * (means - middle) ** 2).sum() / (len(groups) - 1)
    size = (total - (sizes**2).sum() / total) / (len(groups) - 1)
    return Spread(
        task=task,
        figure=figure,
        collectors=len(groups),
        episodes=total,
        between=float(np.sqrt(max((between - within) / size, 0.0))),
        within=float(np.sqrt(within)),
        means=dict(zip(groups, means.tolist(), strict=True)),
    )
