"""What the sensor's own reading is like: range, steps, noise, and what bias and payload leave over."""

from collections.abc import Iterator, Sequence

import numpy as np
from jaxtyping import Bool

from wrenchflow.episode import Stream
from wrenchflow.process.anomalies.saturation import KIND as SATURATION
from wrenchflow.process.finding import Finding, NotAssessed
from wrenchflow.process.metrics.figure import Figure, too_few
from wrenchflow.process.metrics.force import Felt

# Where this share of the values are new, the reading has no steps that could be seen.
_NEW = 0.5


def reading_figures(raw: Stream, findings: Sequence[Finding]) -> Iterator[Figure]:
    """Of the raw reading, whatever else is known.

    Args:
        raw: `wrench_raw` with finite rows only.
        findings: What the detectors found.
    """
    if not len(raw):
        for name in ("max_force_raw", "saturated", "quantisation"):
            yield NotAssessed(kind=name, reason="no sample is finite")
        return
    force = raw.data[:, :3]
    yield "max_force_raw", float(np.linalg.norm(force - np.median(force, axis=0), axis=1).max())
    yield "saturated", sum(each.samples for each in findings if each.kind == SATURATION) / len(raw)
    steps = [step for column in force.T if (step := _step(column)) is not None]
    if steps:
        yield "quantisation", max(steps)
    else:
        yield NotAssessed(kind="quantisation", reason="no value comes twice often enough: finer than the noise")


def free_figures(felt: Felt, noise: np.ndarray) -> Iterator[Figure]:
    """What is left where nothing touches.

    Args:
        felt: The clean force.
        noise: Standard deviation of a raw sample in the bias window. Shape (d,).
    """
    yield "noise", float(noise[:3].max())
    reason = too_few(free_motion=felt.free)
    if reason:
        yield NotAssessed(kind="free_residual", reason=reason)
    else:
        yield "free_residual", rms_norm(felt.labels.data[:, :3], felt.free)


def rms_norm(vectors: np.ndarray, rows: Bool[np.ndarray, " n"]) -> float:
    """Root mean square of the norm of some rows."""
    return float(np.sqrt((vectors[rows] ** 2).sum(axis=1).mean()))


def _step(column: np.ndarray) -> float | None:
    values = np.unique(column)
    if len(values) < 2 or len(values) > _NEW * len(column):
        return None
    # The smallest step but for rounding: of values in float64 that stand for the same reading.
    steps = np.diff(values)
    steps = steps[steps > 1e-9 * np.abs(values).max()]
    return float(np.percentile(steps, 5)) if len(steps) else None
