"""Dropouts, jitter and wrong rates, from the stamps; and readings that are no numbers."""

from collections.abc import Iterator

import numpy as np

from wrenchflow.episode import Stream
from wrenchflow.process.anomalies.look import Look, runs_of
from wrenchflow.process.finding import Finding
from wrenchflow.process.stamps import GAP_PERIODS, MEDIAN_TOLERANCE, STEP_TOLERANCE, UNEVEN_SHARE

DROPOUT, UNEVEN, NOT_FINITE = "dropout", "uneven", "not-finite"


def find_dropouts(look: Look) -> Iterator[Finding]:
    """Find where samples are missing."""
    t = look.episode["wrench_raw"].t  # A reading that is no number is not missing.
    step_ns = np.diff(t)
    if _is_uneven(look):
        return  # There is no period that anything could be missing from.
    for i in np.flatnonzero(step_ns > GAP_PERIODS * look.period_ns):
        missing = round(float(step_ns[i]) / look.period_ns) - 1
        yield Finding(
            kind=DROPOUT,
            severity="warning" if step_ns[i] <= 20_000_000 else "defect",
            start_ns=int(t[i]) + look.period_ns,
            stop_ns=int(t[i + 1]),
            columns=(),
            evidence=f"{missing} samples are missing: {step_ns[i] * 1e-6:.3g} ms between two, expected "
            f"{look.period_ns * 1e-6:.3g} ms",
            samples=missing,
        )


def find_unevenness(look: Look) -> Iterator[Finding]:
    """Find out whether a stream has a rate at all, and the one that it should have."""
    if len(look.t) < 3 or not _is_uneven(look):
        return
    low_ms, median_ms, high_ms = np.percentile(np.diff(look.t) * 1e-6, [0, 50, 100])
    yield Finding(
        kind=UNEVEN,
        severity="defect",
        start_ns=int(look.t[0]),
        stop_ns=look.stop_ns(len(look.t) - 1),
        columns=(),
        evidence=f"steps of {low_ms:.3g} to {high_ms:.3g} ms, median {median_ms:.3g} ms "
        f"({1e3 / median_ms:.3g} Hz), mean rate {look.raw.rate_hz:.4g} Hz; expected {look.period_ns * 1e-6:.3g} ms "
        f"({look.rig.sensor.rate_hz:g} Hz)",
        samples=len(look.t),
    )


def find_not_finite(raw: Stream, period_ns: int) -> Iterator[Finding]:
    """Find readings that are no numbers.

    Args:
        raw: With all of its rows.
        period_ns: Nominal time between two samples [ns].
    """
    wrong = ~np.isfinite(raw.data)
    for first, last in runs_of(np.asarray(wrong.any(axis=1))):
        names = tuple(np.array(raw.signal.columns)[wrong[first:last].any(axis=0)].tolist())
        yield Finding(
            kind=NOT_FINITE,
            severity="defect",
            start_ns=int(raw.t[first]),
            stop_ns=int(raw.t[last - 1]) + period_ns,
            columns=names,
            evidence=f"{last - first} samples of {', '.join(names)} are no numbers",
            samples=last - first,
        )


def _is_uneven(look: Look) -> bool:
    steps = np.diff(look.episode["wrench_raw"].t) / look.period_ns
    if not len(steps):
        return False
    off = float((np.abs(steps - 1.0) > STEP_TOLERANCE).mean())
    return bool(abs(float(np.median(steps)) - 1.0) > MEDIAN_TOLERANCE or off > UNEVEN_SHARE)
