"""Which episodes train and which validate: decided by their ids alone, so a split is the same on every machine."""

import hashlib
from collections.abc import Collection


def validation_ids(episode_ids: Collection[str], fraction: float) -> frozenset[str]:
    """Choose episodes for validation: the first in the order of their hashed ids.

    Args:
        episode_ids: Ids of all episodes, in any order.
        fraction: Share that validates, rounded to whole episodes; above 0, one at least and never all of them.
    """
    ordered = sorted(episode_ids, key=lambda one: hashlib.sha256(one.encode()).digest())
    wanted = max(round(fraction * len(ordered)), 1) if fraction > 0.0 else 0
    return frozenset(ordered[: min(wanted, max(len(ordered) - 1, 0))])
