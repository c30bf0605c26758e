"""What the episodes of a folder say together: distributions, what is unusual, and how far force curves differ."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from wrenchflow.process.assessment import Assessment
from wrenchflow.process.finding import NotAssessed
from wrenchflow.process.metric import METRICS
from wrenchflow.process.spread import AlignedCurves, align

# A value this many robust standard deviations from the median is told; it informs, and decides nothing.
UNUSUAL_SIGMA = 5.0
MIN_EPISODES = 8  # With fewer nobody can tell what is usual.


@dataclass(frozen=True, kw_only=True)
class Distribution:
    """One metric over all episodes in which it could be told.

    Attributes:
        count: In how many episodes.
        low: Smallest value.
        quarter: A quarter of the values lie below.
        median: Half of them do.
        three_quarters: Three quarters do.
        high: Largest value.
    """

    count: int
    low: float
    quarter: float
    median: float
    three_quarters: float
    high: float


@dataclass(frozen=True, kw_only=True)
class Unusual:
    """A value that lies far from those of the other episodes.

    Attributes:
        id: The episode.
        metric: Which figure, or `curve` for the course of its force.
        value: Its value.
        median: That of all episodes.
        sigmas: How far it lies off, in robust standard deviations.
    """

    id: str
    metric: str
    value: float
    median: float
    sigmas: float


@dataclass(frozen=True, kw_only=True, eq=False)
class DataSetQuality:
    """All episodes of a folder.

    Attributes:
        assessments: One an episode, in the order of the names.
        distributions: By the names of the metrics; of those that could be told in one episode at least.
        unusual: Values far from the others, farthest first.
        curves: Force curves aligned in time, by task; of tasks with two episodes in contact at least.
        not_assessed: What could not be told of the whole.
    """

    assessments: tuple[Assessment, ...]
    distributions: Mapping[str, Distribution]
    unusual: tuple[Unusual, ...]
    curves: Mapping[str, AlignedCurves]
    not_assessed: tuple[NotAssessed, ...] = ()

    @property
    def defects(self) -> int:
        """Episodes that something decides against."""
        return sum(not each.is_sound for each in self.assessments)


def look_at_all(assessments: Sequence[Assessment]) -> DataSetQuality:
    """Compare the episodes of a folder with each other.

    Args:
        assessments: One an episode.
    """
    distributions, unusual, unknown = {}, [], []
    for metric in METRICS:
        known = [(each.id, float(each[metric.name])) for each in assessments if each[metric.name] is not None]
        if not known or metric.type is bool:
            continue
        values = np.array([value for _, value in known])
        low, quarter, median, three_quarters, high = np.percentile(values, [0, 25, 50, 75, 100]).tolist()
        distributions[metric.name] = Distribution(
            count=len(known), low=low, quarter=quarter, median=median, three_quarters=three_quarters, high=high
        )
    curves = {}
    for task in sorted({each.task for each in assessments if each.task}):
        alike = [each for each in assessments if each.task == task]
        for metric in METRICS:
            known = [(each.id, float(each[metric.name])) for each in alike if each[metric.name] is not None]
            if metric.type is not bool:
                unusual += _unusual(metric.name, known, least=1.0 if metric.type is int else 0.0)
        drawn = {each.id: np.array(each.curve) for each in alike if each.curve}
        if len(drawn) < 2:
            reason = f"{len(drawn)} episodes of '{task}' have a force curve, 2 needed"
            unknown.append(NotAssessed(kind="spread between demonstrations", reason=reason))
            continue
        curves[task] = align(drawn)
        unusual += _unusual("curve", list(curves[task].distance_n.items()), least=0.1)
    return DataSetQuality(
        assessments=tuple(assessments),
        distributions=distributions,
        unusual=tuple(sorted(unusual, key=lambda each: -each.sigmas)),
        curves=curves,
        not_assessed=tuple(unknown),
    )


def _unusual(name: str, known: Sequence[tuple[str, float]], *, least: float) -> list[Unusual]:
    """What lies far off; `least` is the smallest standard deviation that is believed: counts come in ones."""
    if len(known) < MIN_EPISODES:
        return []
    values = np.array([value for _, value in known])
    median = float(np.median(values))
    # Of values that hardly differ none is unusual: a thousandth of their size is granted to all.
    sigma = max(1.4826 * float(np.median(np.abs(values - median))), 1e-3 * abs(median), least)
    if sigma == 0.0:
        return []
    return [
        Unusual(id=id, metric=name, value=value, median=median, sigmas=abs(value - median) / sigma)
        for id, value in known
        if abs(value - median) > UNUSUAL_SIGMA * sigma
    ]
