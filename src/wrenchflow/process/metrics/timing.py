"""How regularly the samples of each stream come, and how many of them are new."""

from collections.abc import Iterator

import numpy as np

from wrenchflow.episode import Episode, Stream
from wrenchflow.process.assessment import StreamTiming
from wrenchflow.process.finding import NotAssessed
from wrenchflow.process.metrics.figure import Figure

_GAP = 1.5  # Median steps.
_BINS = 40


def stream_timing(name: str, stream: Stream) -> StreamTiming:
    """Timing of one stream.

    Args:
        name: Of the stream.
        stream: Its samples.
    """
    steps_s = np.diff(stream.t) * 1e-9
    if not len(steps_s):
        return StreamTiming(
            name=name,
            samples=len(stream),
            rate_hz=None,
            period_s=None,
            jitter_s=0.0,
            gaps=0,
            longest_s=0.0,
            repeated=0.0,
        )
    period_s = float(np.median(steps_s))
    is_gap = steps_s > _GAP * period_s
    regular = steps_s[~is_gap]
    low, high = np.percentile(steps_s, [0.0, 100.0])
    edges, counts = np.empty(0), np.empty(0, np.int64)
    if high - low > 1e-6 * period_s + 2e-9:  # A stamp is rounded to a nanosecond.
        counts, edges = np.histogram(1e3 * steps_s, _BINS)
    return StreamTiming(
        name=name,
        samples=len(stream),
        rate_hz=stream.rate_hz,
        period_s=period_s,
        jitter_s=float(regular.std()) if len(regular) else 0.0,
        gaps=int(is_gap.sum()),
        longest_s=float(high),
        repeated=repeated(stream),
        steps_ms=tuple(edges.tolist()),
        counts=tuple(counts.tolist()),
    )


def repeated(stream: Stream) -> float:
    """Share of the samples that are the one before again, bit for bit in every column."""
    if len(stream) < 2:
        return 0.0
    return float((stream.data[1:] == stream.data[:-1]).all(axis=1).mean())


def timing_figures(episode: Episode, timing: StreamTiming) -> Iterator[Figure]:
    """Of the raw reading's stamps.

    Args:
        episode: All of it.
        timing: That of `wrench_raw`.
    """
    yield "samples", timing.samples
    yield "duration_s", episode.duration_s
    if timing.rate_hz is None:
        for name in ("rate_hz", "gaps", "longest_gap_s"):
            yield NotAssessed(kind=name, reason=f"{timing.samples} samples, 2 needed")
        return
    yield "rate_hz", timing.rate_hz * (1.0 - timing.repeated)
    yield "gaps", timing.gaps
    yield "longest_gap_s", timing.longest_s
