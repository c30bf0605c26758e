"""Stuck readings, and samples that repeat the one before because the sensor is slower than the log."""

from collections.abc import Iterator

import numpy as np

from wrenchflow.process.anomalies.look import Look, runs_of
from wrenchflow.process.finding import Finding

KIND, REPEATED, CONSTANT = "stuck", "repeated", "constant"
LEAST = 10  # Samples that are the same in a column: a sensor with noise repeats a value once or twice.
SHARE = 0.05  # Of the rows that repeat the one before; from here on the sensor is slower than the log.


def find_stuck(look: Look) -> Iterator[Finding]:
    """Find columns that never change, rows that repeat at a rate, and values that stand still for a while."""
    if len(look.data) < 3:
        return
    same = np.diff(look.data, axis=0) == 0.0
    dead = same.all(axis=0)
    span = int(look.t[0]), look.stop_ns(len(look.t) - 1)
    if dead.any():
        names = tuple(np.array(look.columns)[dead].tolist())
        values = ", ".join(f"{value:.4g}" for value in look.data[0, dead])
        yield Finding(
            kind=CONSTANT,
            severity="defect",
            start_ns=span[0],
            stop_ns=span[1],
            columns=names,
            evidence=f"{', '.join(names)} never change from {values}",
            samples=len(look.data),
        )
    if dead.all():
        return
    whole = same[:, ~dead].all(axis=1)
    for i in np.flatnonzero(~dead):
        for first, last in runs_of(same[:, i]):
            if last - first + 1 < LEAST:
                continue
            stuck = same[first:last].all(axis=0) & ~dead & ~_at_end(look.data, first)
            if not stuck[i] or np.flatnonzero(stuck)[0] != i:
                continue  # It is another column's run, or one of a reading that is cut off.
            names = tuple(np.array(look.columns)[stuck].tolist())
            yield Finding(
                kind=KIND,
                severity="defect",
                start_ns=int(look.t[first]),
                stop_ns=look.stop_ns(last),
                columns=names,
                evidence=f"{', '.join(names)} stand still for {last - first + 1} samples, expected {LEAST - 1} at most",
                samples=last - first + 1,
            )
    # Without the stuck runs: what is left repeats now and then.
    short = whole.copy()
    for first, last in runs_of(whole):
        if last - first + 1 >= LEAST:
            short[first:last] = False
    share = float(short.mean())
    if share > SHARE:
        rate_hz = (1.0 - share) * look.rig.sensor.rate_hz
        yield Finding(
            kind=REPEATED,
            severity="warning",
            start_ns=span[0],
            stop_ns=span[1],
            columns=look.columns,
            evidence=f"{share:.0%} of the rows repeat the one before: about {rate_hz:.0f} values a second are new, "
            f"expected {look.rig.sensor.rate_hz:g}",
            samples=int(short.sum()),
        )


def _at_end(data: np.ndarray, row: int) -> np.ndarray:
    """Which columns are at their largest or smallest value of all."""
    return (data[row] == data.max(axis=0)) | (data[row] == data.min(axis=0))
