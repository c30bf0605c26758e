"""Spikes: samples that leave their neighbourhood and come back more abruptly than a force can."""

from collections.abc import Iterator

import numpy as np

from wrenchflow.filtering import CausalLowpass
from wrenchflow.process.anomalies.look import HALF, Look, runs_of
from wrenchflow.process.finding import Finding
from wrenchflow.process.stamps import GAP_PERIODS
from wrenchflow.rig import Sensor

KIND = "spike"
SIGMAS = 8.0  # Of free motion. Five would be met once in a quarter of an hour by the noise of six columns alone.
_LEAST = 3.0  # Times the noise that the rig grants its sensor.
_LONGEST = 3  # Samples.
_AROUND, _LOCAL = 50, 4.0  # Samples to either side, and how far it stands out of their mean size: a tone is no spike.


def steepest(sensor: Sensor) -> float:
    """The largest share of its height that a blow, however short, rises or falls by in one sample.

    A sensor has a low-pass of its own, so that even an impulse arrives over several samples; what rises faster came
    after it, from a cable or a converter.
    """
    if sensor.lowpass_hz >= 0.5 * sensor.rate_hz:
        return 1.0
    blow = np.zeros((64, 1))
    blow[16] = 1.0
    heard = CausalLowpass(sensor.lowpass_hz, sensor.rate_hz, order=2, width=1).push(blow)
    return float(np.abs(np.diff(heard, axis=0)).max() / np.ptp(heard))


def find_spikes(look: Look) -> Iterator[Finding]:
    """Find them, each with its size."""
    rough, sigma = look.rough, look.sigma
    bound = steepest(look.rig.sensor)
    limit = 0.5 * (bound + 1.0)
    is_torn = np.diff(look.t) > GAP_PERIODS * look.period_ns  # Over a gap nobody knows how steeply it went.
    found: list[tuple[int, int, int]] = []
    for i in np.flatnonzero(sigma > 0.0):
        least = max(SIGMAS * sigma[i], _LEAST * look.noise[i])
        for first, last in runs_of(np.abs(rough[:, i]) > least):
            if last - first > _LONGEST or first < 1 or last >= len(rough) or is_torn[first - 1 : last].any():
                continue
            around = rough[max(first - HALF, 0) : last + HALF, i]
            wide = np.abs(rough[max(first - _AROUND, 0) : last + _AROUND, i])
            rest = (wide.sum() - np.abs(around).sum()) / max(len(wide) - len(around), 1)
            if np.abs(rough[first:last, i]).max() < _LOCAL * rest:
                continue
            # Of the reading itself, for a median jumps from one side of a blow to the other.
            column = look.data[max(first - HALF, 0) : last + HALF, i]
            flanks = np.abs(look.data[[first, last - 1], i] - look.data[[first - 1, last], i])
            if flanks.min() > limit * np.ptp(column) or (bound >= 1.0 and look.free[first:last].all()):
                found.append((first, last, int(i)))
    found.sort()
    while found:
        first, last, worst = found[0]
        near = [each for each in found if each[0] < last]
        found = found[len(near) :]
        last = max(each[1] for each in near)
        sizes = {i: float(np.abs(rough[a:b, i]).max()) for a, b, i in near}
        worst = max(sizes, key=lambda i: sizes[i] / sigma[i])
        yield Finding(
            kind=KIND,
            severity="warning",
            start_ns=int(look.t[first]),
            stop_ns=look.stop_ns(last - 1),
            columns=tuple(look.columns[i] for i in sorted(sizes)),
            evidence=f"{sizes[worst]:.3g} {look.units[worst]} off the running median in {look.columns[worst]}, "
            f"{sizes[worst] / sigma[worst]:.0f} times the scatter of {look.where_sigma}, steeper than a blow can be",
            samples=last - first,
        )
