"""Saturation: readings at the end of the sensor's range, and tops that are flat below it."""

from collections.abc import Iterator

import numpy as np

from wrenchflow.process.anomalies.implausible import BEYOND
from wrenchflow.process.anomalies.look import Look
from wrenchflow.process.finding import Finding

KIND = "saturation"
NEAR = 0.99  # Share of the range from which on a reading is not to be believed.
# Samples at the very largest value of a recording, over those at the next one: of noise the largest is the rarest.
_FLAT, _OFTEN = 10, 5


def find_saturation(look: Look) -> Iterator[Finding]:
    """Find where a column is at the end of its range, or where its largest values are all the same."""
    limits = look.rig.sensor.range[: look.data.shape[1]]
    for i, name in enumerate(look.columns):
        for sense in (1.0, -1.0):
            column = sense * look.data[:, i]
            at_end = (column >= NEAR * limits[i]) & (column <= BEYOND * limits[i])
            said = f"within 1 % of the range of {limits[i]:g} {look.units[i]}"
            if not at_end.any() and look.sigma[i] > 0.0:
                top, below = (*np.unique(column)[::-1][:2], np.nan)[:2]
                flat = column == top
                if flat.sum() < max(_FLAT, _OFTEN * (column == below).sum()):
                    continue
                at_end, said = flat, f"cut off at {sense * top:.4g} {look.units[i]}"
            if at_end.any():
                first, last = np.flatnonzero(at_end)[[0, -1]]
                yield Finding(
                    kind=KIND,
                    severity="defect",
                    start_ns=int(look.t[first]),
                    stop_ns=look.stop_ns(int(last)),
                    columns=(name,),
                    evidence=f"{name} is {said} in {int(at_end.sum())} samples",
                    samples=int(at_end.sum()),
                )
