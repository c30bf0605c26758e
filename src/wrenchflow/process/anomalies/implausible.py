"""Readings that no sensor of this kind can give: units that are not what they are said to be."""

from collections.abc import Iterator

import numpy as np

from wrenchflow.process.anomalies.look import Look
from wrenchflow.process.finding import Finding

KIND = "implausible"
BEYOND = 1.5  # Times the range: no sensor reads further than it saturates, but for a little headroom.


def find_implausible(look: Look) -> Iterator[Finding]:
    """Find columns that go beyond the sensor's range."""
    limits = look.rig.sensor.range[: look.data.shape[1]]
    for i, name in enumerate(look.columns):
        beyond = np.abs(look.data[:, i]) > BEYOND * limits[i]
        if not beyond.any():
            continue
        first, last = np.flatnonzero(beyond)[[0, -1]]
        largest = float(np.abs(look.data[:, i]).max())
        yield Finding(
            kind=KIND,
            severity="defect",
            start_ns=int(look.t[first]),
            stop_ns=look.stop_ns(int(last)),
            columns=(name,),
            evidence=f"{name} reads up to {largest:.3g} {look.units[i]}, {int(beyond.sum())} samples beyond a sensor "
            f"that ends at {limits[i]:g} {look.units[i]}: the unit is wrong, or the range in the rig",
            samples=int(beyond.sum()),
        )
