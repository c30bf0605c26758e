"""Quaternions that change sign between two samples: the same rotation, but no interpolation or filter survives it."""

from collections.abc import Iterator

import numpy as np

from wrenchflow.process.anomalies.look import Look
from wrenchflow.process.finding import Finding
from wrenchflow.signals import POSE

KIND = "quaternion-flip"


def find_quaternion_flips(look: Look) -> Iterator[Finding]:
    """Find them in every stream of poses; all flips of a stream together."""
    for name, stream in look.episode.streams.items():
        if stream.signal != POSE or len(stream) < 2:
            continue
        quat = stream.data[:, 3:]
        flips = np.flatnonzero((quat[1:] * quat[:-1]).sum(axis=1) < -0.5)
        if len(flips):
            yield Finding(
                kind=KIND,
                severity="warning",
                start_ns=int(stream.t[flips[0]]),
                stop_ns=int(stream.t[flips[-1] + 1]) + 1,
                columns=tuple(f"{name}.{column}" for column in POSE.columns[3:]),
                evidence=f"the quaternion of {name} changes its sign {len(flips)} times",
                samples=len(flips),
            )
