"""The episodes of a folder as its page shows them: names, links, and where a finding is."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape

from wrenchflow.pages.page import NBSP, address, link
from wrenchflow.process.assessment import Assessment
from wrenchflow.process.finding import Finding

_WHOLE = 0.99  # A finding that lasts for this share of its episode is of all of it.


@dataclass(frozen=True, kw_only=True)
class Shown:
    """The episodes, each with its page.

    Attributes:
        assessments: One an episode.
        pages: Relative path of each one's page, in the same order; empty where there are no pages.
    """

    assessments: Sequence[Assessment]
    pages: Sequence[str]

    def __post_init__(self) -> None:
        if self.pages and len(self.pages) != len(self.assessments):
            raise ValueError(f"pages must be as many as episodes: got {len(self.pages)} for {len(self.assessments)}.")

    @cached_property
    def numbers(self) -> dict[str, int]:
        """Number of each episode, by its id."""
        return {each.id: number for number, each in enumerate(self.assessments)}

    def name(self, number: int) -> str:
        """An episode's id, as a link to its page where there is one; HTML."""
        id = self.assessments[number].id
        return link(id, self.pages[number]) if self.pages else f"<span>{escape(id)}</span>"

    def address(self, number: int) -> str:
        """Address of an episode's page; empty where there is none."""
        return address(self.pages[number]) if self.pages else ""


def is_whole(finding: Finding, assessment: Assessment) -> bool:
    """Whether a finding is of all of its episode."""
    seconds, whole_s = (finding.stop_ns - finding.start_ns) * 1e-9, assessment["duration_s"]
    return seconds <= 0.0 or (whole_s is not None and seconds >= _WHOLE * whole_s)


def place(finding: Finding, assessment: Assessment) -> str:
    """Where in its episode a finding is; plain text."""
    if is_whole(finding, assessment):
        return "all of it"
    start_s, seconds = (finding.start_ns - assessment.zero_ns) * 1e-9, (finding.stop_ns - finding.start_ns) * 1e-9
    return f"{start_s:.3f}{NBSP}s, for {seconds:.3g}{NBSP}s"
