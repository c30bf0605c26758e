"""What is kept of a whole data set while its episodes come by: a row of figures each, and sums."""

from collections.abc import Iterator, Sequence

from wrenchflow.datasets.analysis.distribution import Distribution, Moments
from wrenchflow.datasets.analysis.figures import EpisodeFigures, Looked
from wrenchflow.datasets.analysis.trajectory import Labels
from wrenchflow.datasets.analysis.voxels import Workspace

# By what episodes are compared.
GROUPS = ("task", "lab", "collector", "scene", "success")
OTHERS = "(others)"
# Sums are kept of so many groups of a kind: where each episode has a task in words of its own, memory would grow.
_MOST_GROUPS = 200

# A table, by its name and columns: arms with other joints are other tables.
Named = tuple[str, tuple[str, ...], tuple[str, ...]]


class Totals:
    """Takes episodes in, one by one.

    Attributes:
        episodes: What is kept of each.
        left_out: Episodes that could not be looked at: where they are, and why.
        workspace: Where tools have been.
    """

    def __init__(self) -> None:
        self.episodes: list[EpisodeFigures] = []
        self.left_out: list[tuple[str, str]] = []
        self.workspace = Workspace()
        self._all: dict[Named, Distribution] = {}
        self._groups: dict[str, dict[str, dict[Named, Moments]]] = {kind: {} for kind in GROUPS}

    def add(self, looked: Looked) -> None:
        """Take in an episode."""
        if looked.left_out:
            self.left_out.append((looked.figures.place, looked.left_out))
            return
        self.episodes.append(looked.figures)
        self.workspace.add(looked.voxels, looked.visits)
        places = [self._group(kind, group) for kind, group in groups_of(looked.figures.labels)]
        for name, (columns, units, tally) in looked.tallies.items():
            named = (name, columns, units)
            if named not in self._all:
                self._all[named] = Distribution(len(columns))
            self._all[named].add(tally)
            for place in places:
                if named not in place:
                    place[named] = Moments(len(columns))
                place[named].add(tally)

    def tables(self) -> Sequence[tuple[Named, Distribution]]:
        """What all episodes come to, by table."""
        return list(self._all.items())

    def grouped(self) -> Iterator[tuple[str, str, Named, Moments]]:
        """What each group comes to: its kind, its name, the table, and the sums."""
        for kind, groups in self._groups.items():
            for group, tables in sorted(groups.items()):
                for named, moments in tables.items():
                    yield kind, group, named, moments

    def _group(self, kind: str, group: str) -> dict[Named, Moments]:
        groups = self._groups[kind]
        if group not in groups and len(groups) >= _MOST_GROUPS:
            group = OTHERS
        return groups.setdefault(group, {})


def groups_of(labels: Labels) -> list[tuple[str, str]]:
    """The groups that an episode is in, of each kind; a kind that nobody says is left out."""
    outcome = {True: "success", False: "failure", None: ""}[labels.success]
    said = zip(GROUPS, (labels.task, labels.lab, labels.collector, labels.scene, outcome), strict=True)
    return [(kind, group) for kind, group in said if group]
