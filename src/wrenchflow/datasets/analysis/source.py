"""Where an analysis reads its episodes from: one kind of data set each, told apart by what is there."""

from collections.abc import Sequence
from pathlib import Path
from typing import Protocol, runtime_checkable

from wrenchflow.datasets.analysis.config import AnalysisConfig
from wrenchflow.datasets.analysis.trajectory import Trajectory


@runtime_checkable
class Source(Protocol):
    """A data set whose episodes can be read one by one, in any process."""

    @property
    def kind(self) -> str:
        """What it is, for a person."""
        ...

    def places(self) -> Sequence[str]:
        """Where its episodes are; plain texts, so that there may be very many."""
        ...

    def read(self, place: str, config: AnalysisConfig) -> Trajectory:
        """Read one of them, and nothing else.

        Raises:
            WrenchflowError: If it cannot be read, or is no episode.
        """
        ...


def relative(path: Path, root: Path) -> str:
    """Where a file is in a data set, or its name if it is the data set."""
    return path.relative_to(root).as_posix() if path != root else path.name
