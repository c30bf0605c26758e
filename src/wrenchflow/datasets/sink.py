"""What data sets are written through: an episode at a time, so that memory does not grow with their number."""

from typing import Protocol

from wrenchflow.observation import Steps


class Sink(Protocol):
    """Takes episodes; each format has a context manager that yields one and makes the data set whole at its end."""

    def add(self, steps: Steps) -> None:
        """Write an episode.

        Raises:
            DatasetError: If it cannot be part of this data set; what was added before stays.
        """
        ...
