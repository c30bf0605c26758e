"""One thing that a machine can or cannot do, and what that means."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

State = Literal["ok", "warning", "missing"]


@dataclass(frozen=True, kw_only=True)
class Check:
    """What was looked at, and what was found.

    Attributes:
        name: What was looked at.
        state: `ok`, `warning` for what works but not well, `missing` for what is not there or does not work.
        found: What was found, with units.
        means: What follows from it for whoever uses this machine; empty where all is well.
        todo: What to do about it; empty where there is nothing.
        essential: Whether nothing can be recorded without it.
        figures: What was measured, by name, with the unit in the name.
    """

    name: str
    state: State
    found: str
    means: str = ""
    todo: str = ""
    essential: bool = False
    figures: Mapping[str, int | float | str | None] = field(default_factory=dict)

    @property
    def stops(self) -> bool:
        """Whether it is in the way of everything else."""
        return self.essential and self.state == "missing"


def bytes_said(count: int | float) -> str:
    """A number of bytes, for a person."""
    for unit in ("B", "KiB", "MiB"):
        if count < 1000:
            return f"{count:.3g} {unit}"
        count /= 1024
    return f"{count:,.1f} GiB"


def seconds_said(seconds: int | float) -> str:
    """A short time, for a person."""
    if seconds < 1e-3:
        return f"{seconds * 1e6:.3g} us"
    return f"{seconds * 1e3:.3g} ms" if seconds < 1.0 else f"{seconds:.3g} s"
