"""What `process` says of one episode: figures, findings, and what it could not tell."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from wrenchflow.process.finding import Finding, NotAssessed
from wrenchflow.process.metric import NAMES, Value


@dataclass(frozen=True, kw_only=True)
class StreamTiming:
    """How regularly the samples of one stream come.

    Attributes:
        name: The stream.
        samples: How many.
        rate_hz: Mean rate [Hz]; None for fewer than two samples.
        period_s: Median step between samples [s]; None for fewer than two.
        jitter_s: Standard deviation of the steps that are no gaps [s].
        gaps: Steps longer than one and a half median periods.
        longest_s: Longest step [s].
        repeated: Share of samples that repeat the one before in every column, to the last bit.
        steps_ms: Edges of a histogram of the steps [ms], one more than `counts`; empty where all steps are equal.
        counts: Steps in each bin.
    """

    name: str
    samples: int
    rate_hz: float | None
    period_s: float | None
    jitter_s: float
    gaps: int
    longest_s: float
    repeated: float
    steps_ms: tuple[float, ...] = ()
    counts: tuple[int, ...] = ()


@dataclass(frozen=True, kw_only=True)
class PhaseQuality:
    """Figures of one phase of an episode.

    Attributes:
        label: The phase.
        start_s: Where it begins, from the first stamp of the episode [s].
        stop_s: Where it ends [s].
        values: Figures, under the names of the episode's own metrics; what could not be told is None.
        why: The reason for each that is None.
    """

    label: str
    start_s: float
    stop_s: float
    values: Mapping[str, Value]
    why: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Assessment:
    """What is known of one episode after `process`.

    Attributes:
        id: The episode.
        task: Its task.
        success: What the recording says came of it; None where it does not say.
        refused: Why there is no clean recording of it; empty if there is one.
        values: Every metric of `METRICS` by its name; None where it could not be told, and `not_assessed` says why.
        snr: Signal-to-noise by axis [dB], as far as it could be told.
        bias: Sensor bias, in the columns of the raw stream [N, N.m]; empty where it could not be told.
        findings: What is wrong, by time.
        not_assessed: What could not be told, and why; of a metric, its `kind` is the metric's name.
        phases: Figures of each phase, in order.
        streams: Timing of each stream.
        notes: What was assumed when the recording was imported, or done to it here, as sentences.
        curve: Norm of the force from the first contact's start to the last one's end, at evenly spaced times [N].
        zero_ns: Where a person counts time from: the end of the tare, or else the first stamp [ns].
        contact_start_m: Where the tcp was at the first contact, from the goal if it is known, else in its own frame.
    """

    id: str
    task: str
    success: bool | None = None
    refused: str = ""
    values: Mapping[str, Value] = field(default_factory=lambda: dict.fromkeys(NAMES))
    snr: Mapping[str, float | None] = field(default_factory=dict)
    bias: tuple[float, ...] = ()
    findings: Sequence[Finding] = ()
    not_assessed: Sequence[NotAssessed] = ()
    phases: Sequence[PhaseQuality] = ()
    streams: Sequence[StreamTiming] = ()
    notes: Sequence[str] = ()
    curve: tuple[float, ...] = ()
    zero_ns: int = 0
    contact_start_m: tuple[float, float, float] | None = None

    def __getitem__(self, name: str) -> Any:
        """A metric's value by its name."""
        return self.values[name]

    def why_not(self, name: str) -> str:
        """Why a metric could not be told; empty if it could."""
        return next((each.reason for each in self.not_assessed if each.kind == name), "")

    def count(self, severity: str) -> int:
        """How many findings there are of a severity."""
        return sum(finding.severity == severity for finding in self.findings)

    @property
    def is_sound(self) -> bool:
        """Whether nothing decides against it."""
        return not self.refused and not self.count("defect")
