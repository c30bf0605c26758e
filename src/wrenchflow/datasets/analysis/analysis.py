"""What is known of a whole data set, once all episodes were looked at."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from wrenchflow.datasets.analysis.collectors import Spread, spreads
from wrenchflow.datasets.analysis.config import AnalysisConfig
from wrenchflow.datasets.analysis.findings import Finding, find
from wrenchflow.datasets.analysis.relevance import Relevance, rank
from wrenchflow.datasets.analysis.totals import Totals, groups_of
from wrenchflow.datasets.analysis.twins import Twins, find_twins


@dataclass(frozen=True, kw_only=True)
class Group:
    """Episodes that have something in common.

    Attributes:
        kind: What: a task, a lab and so on.
        name: Which.
        episodes: Their numbers.
    """

    kind: str
    name: str
    episodes: tuple[int, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Analysis:
    """What is known.

    Attributes:
        kind: What kind of data set it is.
        totals: Rows and sums.
        config: How it was looked at.
        groups: By task, lab, collector, scene and success; the largest of each kind first.
        findings: What is wrong, defects first.
        twins: Near duplicates.
        spreads: How far collectors differ.
        relevance: Episodes by relevance to the configuration's task; empty without one.
    """

    kind: str
    totals: Totals
    config: AnalysisConfig
    groups: tuple[Group, ...]
    findings: tuple[Finding, ...]
    twins: tuple[Twins, ...]
    spreads: tuple[Spread, ...]
    relevance: tuple[Relevance, ...]

    @classmethod
    def of(cls, kind: str, totals: Totals, config: AnalysisConfig) -> "Analysis":
        """Compare the episodes that were looked at."""
        episodes = totals.episodes
        findings, twins = find(episodes), find_twins(episodes, config)
        return cls(
            kind=kind,
            totals=totals,
            config=config,
            groups=_groups(totals),
            findings=findings,
            twins=twins,
            spreads=spreads(episodes),
            relevance=rank(config.task, episodes, findings, twins) if config.task else (),
        )

    @property
    def defective(self) -> frozenset[int]:
        """Numbers of the episodes with a defect."""
        return frozenset(i for finding in self.findings if finding.kind.is_defect for i in finding.episodes)

    def values(self, figure: str, episodes: Sequence[int] | None = None) -> np.ndarray:
        """A figure of all episodes, or of some, that have it. Shape (k,)."""
        chosen = self.totals.episodes if episodes is None else [self.totals.episodes[i] for i in episodes]
        found = [each.values.get(figure) for each in chosen]
        return np.array([value for value in found if value is not None], np.float64)


def _groups(totals: Totals) -> tuple[Group, ...]:
    members: dict[tuple[str, str], list[int]] = {}
    order: dict[str, int] = {}
    for i, episode in enumerate(totals.episodes):
        for kind, name in groups_of(episode.labels):
            members.setdefault((kind, name), []).append(i)
            order.setdefault(kind, len(order))
    found = [Group(kind=kind, name=name, episodes=tuple(each)) for (kind, name), each in members.items()]
    return tuple(sorted(found, key=lambda group: (order[group.kind], -len(group.episodes), group.name)))
