"""How regularly samples came: a table over all episodes, and small histograms of one."""

from collections.abc import Sequence
from html import escape

import numpy as np

from wrenchflow.pages.page import NBSP, section, table
from wrenchflow.process.assessment import StreamTiming
from wrenchflow.process.report.shown import Shown
from wrenchflow.process.report.words import NOT_ASSESSED, count

_HEAD = ("stream", "episodes", "rate, median", "rate, lowest to highest", "jitter, largest", "gaps", "longest step")


def timing_section(shown: Shown) -> str:
    """Every stream over all episodes."""
    by_name: dict[str, list[StreamTiming]] = {}
    for assessment in shown.assessments:
        for timing in assessment.streams:
            by_name.setdefault(timing.name, []).append(timing)
    if not by_name:
        return section("Streams and timing", "<p>not assessed: no stream could be read.</p>")
    rows = [_row(name, timings) for name, timings in sorted(by_name.items())]
    text = (
        "<p>A gap is a step longer than one and a half of the stream's median steps; jitter is the standard deviation "
        "of the steps that are no gaps. Each episode's page has a histogram of them.</p>"
    )
    return section("Streams and timing", text, table(_HEAD, rows, wide=True))


def _row(name: str, timings: Sequence[StreamTiming]) -> tuple[str, ...]:
    rates = [each.rate_hz for each in timings if each.rate_hz is not None]
    known = bool(rates)
    return (
        f"<code>{escape(name)}</code>",
        f"{len(timings)}",
        _rate(float(np.median(rates))) if known else NOT_ASSESSED,
        f"{min(rates):.1f} to {_rate(max(rates))}" if known else NOT_ASSESSED,
        _seconds(max(each.jitter_s for each in timings)) if known else NOT_ASSESSED,
        f"{sum(each.gaps for each in timings)}",
        _seconds(max(each.longest_s for each in timings)) if known else NOT_ASSESSED,
    )


def _rate(rate_hz: float) -> str:
    return f"{rate_hz:,.1f}{NBSP}Hz"


def _seconds(seconds: float) -> str:
    if seconds < 1e-9:  # Stamps are whole nanoseconds.
        return f"0{NBSP}us"
    return f"{1e3 * seconds:,.3g}{NBSP}ms" if seconds >= 1e-3 else f"{1e6 * seconds:.3g}{NBSP}us"


def streams_section(streams: Sequence[StreamTiming]) -> str:
    """Every stream of one episode, with a histogram of the steps between its samples."""
    if not streams:
        return section("Timing", "<p>not assessed: no stream could be read.</p>")
    rows = [
        (
            f"<code>{escape(each.name)}</code>",
            f"{each.samples:,}",
            _rate(each.rate_hz) if each.rate_hz is not None else NOT_ASSESSED,
            _seconds(each.jitter_s) if each.rate_hz is not None else NOT_ASSESSED,
            f"{each.gaps}",
            _seconds(each.longest_s) if each.rate_hz is not None else NOT_ASSESSED,
            f"{100.0 * each.repeated:.1f}{NBSP}%",
            f'<td class="text">{_histogram(each)}</td>',
        )
        for each in streams
    ]
    head = ("stream", "samples", "rate", "jitter", "gaps", "longest step", "repeated", "steps between samples")
    text = "<p>Bars are as high as the logarithm of how many steps they hold, so that a single one can be seen.</p>"
    return section("Timing", text, table(head, rows, wide=True))


def _histogram(timing: StreamTiming) -> str:
    if timing.period_s is None:
        return NOT_ASSESSED + ": " + count(timing.samples, "sample")
    if not timing.counts:
        return f"all {_seconds(timing.period_s)}"
    counts = np.asarray(timing.counts, np.float64)
    heights = np.log1p(counts) / np.log1p(counts.max())
    width = 100.0 / len(counts)
    bars = "".join(
        f'<rect x="{width * k:.2f}" y="{24.0 * (1.0 - height):.2f}" width="{0.9 * width:.2f}" '
        f'height="{24.0 * height:.2f}"/>'
        for k, height in enumerate(heights)
        if height
    )
    ends = f"{timing.steps_ms[0]:.3g} to {timing.steps_ms[-1]:.3g}{NBSP}ms"
    return (
        f'<svg class="steps" viewBox="0 0 100 24" preserveAspectRatio="none" role="img" '
        f'aria-label="{escape(ends)}">{bars}</svg><small>{ends}</small>'
    )
