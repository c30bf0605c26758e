"""The chance that a hand meets, drawn as it is needed: most attempts end long before their time is over."""

import numpy as np
from jaxtyping import Float

from wrenchflow.collect.hand import WHITE_WIDTH

_BLOCK = 64  # To draw a few costs as much as to draw many.


class Chance:
    """Standard normal numbers, a row a period; they are the same in whatever blocks they are drawn."""

    def __init__(self, rng: np.random.Generator, periods: int) -> None:
        """Draw nothing yet.

        Args:
            rng: Which nobody else may use from now on.
            periods: How many there may be.
        """
        self._rng, self._drawn = rng, 0
        self._rows = np.empty((periods, WHITE_WIDTH))

    def up_to(self, periods: int) -> Float[np.ndarray, "n w"]:
        """All rows, of which the first `periods` hold numbers."""
        if periods > self._drawn:
            stop = min(max(periods, self._drawn + _BLOCK), len(self._rows))
            self._rng.standard_normal(out=self._rows[self._drawn : stop])
            self._drawn = stop
        return self._rows
