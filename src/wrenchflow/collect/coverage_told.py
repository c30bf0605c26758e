"""Coverage in words, for whoever has its plain figures; loads nothing."""

from collections.abc import Mapping
from typing import Any


def coverage_told(coverage: Mapping[str, Any]) -> dict[str, str]:
    """Cells that were seen of those there are, and successes of attempts by who made them, in a few words each."""
    shares = {name: f"{coverage[name][0]} of {coverage[name][1]} cells" for name in ("starts", "goals")}
    people = ", ".join(f"{who} {done} of {tried}" for who, (done, tried) in coverage["successes_by"].items())
    return {**shares, "successes_by": people or "nobody yet"}
