"""What data sets are written through: an episode at a time, so that memory does not grow with their number."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from wrenchflow.datasets.checks import Admission
from wrenchflow.observation import Steps


@runtime_checkable
class Sink(Protocol):
    """Takes episodes; each format has a context manager that yields one and makes the data set whole at its end."""

    def add(self, steps: Steps) -> None:
        """Write an episode that an `Admission` let in: the data set's, or that of all that are written at once.

        Raises:
            DatasetError: If this format cannot hold it; what was added before stays.
        """
        ...


def add_all(sink: Sink, steps: Sequence[Steps]) -> None:
    """Write episodes that are in memory.

    Raises:
        DatasetError: If one cannot be part of the data set.
    """
    admission = Admission()
    for one in steps:
        admission.admit([one])
        sink.add(one)
