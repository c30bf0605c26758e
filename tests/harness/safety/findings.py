"""What a check found: the worst value of a run beside the limit that it was to keep."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Finding:
    """One invariant in one run.

    Attributes:
        name: Of the invariant, and of what part of it.
        worst: The largest value, in the limit's unit; -inf where there was nothing to check.
        limit: What it must not exceed.
        tick: When.
    """

    name: str
    worst: float
    limit: float
    tick: int = 0

    @property
    def holds(self) -> bool:
        """Whether the limit was kept; NaN keeps none."""
        return self.worst <= self.limit

    @property
    def is_checked(self) -> bool:
        """Whether there was anything to check; where there was not, the limit was kept by nobody."""
        return self.worst != -math.inf

    @property
    def badness(self) -> tuple[bool, float]:
        """Larger is worse: what is broken is worse than what holds, and NaN is worse than any number."""
        return not self.holds, self.worst if self.worst == self.worst else math.inf

    def __str__(self) -> str:
        verdict = "holds" if self.holds else "BROKEN"
        return f"{self.name}: {verdict}, {self.worst:.6g} of {self.limit:.6g} at tick {self.tick}"


def worst_of(name: str, values: np.ndarray, limit: float, where: np.ndarray | None = None) -> Finding:
    """The largest of some values, one or more a tick, against one limit.

    Args:
        name: Of the invariant.
        values: Shape (n, ...).
        limit: What none may exceed.
        where: Ticks to look at, all if None. Shape (n,).
    """
    ticks = np.arange(len(values)) if where is None else np.flatnonzero(where)
    if not len(ticks):
        return Finding(name, -np.inf, limit)
    largest = np.asarray(values)[ticks].reshape(len(ticks), -1).max(1)
    # NaN is worse than any number.
    index = int(np.argmax(np.where(np.isnan(largest), np.inf, largest)))
    return Finding(name, float(largest[index]), limit, int(ticks[index]))


def unchecked(findings: Iterable[Finding]) -> list[str]:
    """Names of what was nowhere checked, in any of many runs: that it holds says nothing."""
    found = list(findings)
    return sorted({each.name for each in found} - {each.name for each in found if each.is_checked})
