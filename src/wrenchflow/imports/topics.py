"""What the takes of files with topics have in common."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.errors import RecordingError
from wrenchflow.imports.mapping import Clock, Values


class Topics:
    """A file of topics; it is one take."""

    def __init__(self, id: str, path: Path) -> None:
        """Name it."""
        self.id, self._path = id, path

    def numbers(self, part: Values, width: int | None, where: str) -> Float[np.ndarray, "n k"]:
        """See `Take`."""
        raise self._no_table(where)

    def stamps(self, clock: Clock, where: str) -> Int64[np.ndarray, " n"]:
        """See `Take`."""
        raise self._no_table(where)

    def _no_table(self, where: str) -> RecordingError:
        return RecordingError(
            f"{where}: {self._path} has topics, no columns and no variables: a topic has to be stated."
        )
