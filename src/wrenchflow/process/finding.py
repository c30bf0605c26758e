"""What is wrong with a recording: what, where, in which columns, how bad, and by what evidence."""

from dataclasses import dataclass
from typing import Literal

# A defect decides against an episode; a warning is to be looked at; a note only informs.
Severity = Literal["defect", "warning", "note"]


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that a detector found in a recording.

    Attributes:
        kind: Name of the detector's kind, such as `spike`.
        severity: How bad it is.
        start_ns: Where it begins [ns].
        stop_ns: Where it ends, exclusive [ns].
        columns: Columns that show it, such as `fx`; empty where it is of the stamps.
        evidence: What was found and what was expected, with figures and units.
        samples: How many samples show it.
    """

    kind: str
    severity: Severity
    start_ns: int
    stop_ns: int
    columns: tuple[str, ...]
    evidence: str
    samples: int = 0


@dataclass(frozen=True, kw_only=True)
class NotAssessed:
    """What could not be looked at.

    Attributes:
        kind: Of the findings that there might be.
        reason: Why nobody can tell.
    """

    kind: str
    reason: str
