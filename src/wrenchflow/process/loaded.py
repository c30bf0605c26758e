"""Readings that are never free of load: nobody can tell the sensor's bias from them."""

from collections.abc import Iterator

import numpy as np

from wrenchflow.episode import Episode
from wrenchflow.errors import WrenchflowError
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.finding import Finding
from wrenchflow.process.mount import GRAVITY_M_S2
from wrenchflow.process.stamps import finite
from wrenchflow.rig import rig_of

ALWAYS_LOADED = "always-loaded"


def always_loaded(episode: Episode, config: ProcessConfig) -> Iterator[Finding]:
    """Find out whether any stretch of a raw reading could be free of contact, whatever the arm's orientation.

    Args:
        episode: With `wrench_raw` and a rig; without them nothing is said.
        config: How long a bias window is, and how far a bias may be from zero.
    """
    try:
        raw, rig = finite(episode["wrench_raw"]), rig_of(episode.meta, "its metadata")
    except WrenchflowError:
        return  # It is a finding already that they are missing.
    if len(raw) < 2:
        return
    # Means over stretches as long as the shortest bias window.
    edges = np.arange(raw.t[0], raw.t[-1] + 1, round(config.bias.min_window_s * 1e9))
    first = np.unique(np.searchsorted(raw.t, edges))
    means = np.add.reduceat(raw.data[:, :3], first, axis=0) / np.diff([*first, len(raw)])[:, None]
    least_n = float(np.linalg.norm(means, axis=1).min())
    # A bias on each of three axes, and the payload, whichever way it hangs.
    most_n = config.bias.max_force_n * 3.0**0.5 + rig.payload.mass_kg * GRAVITY_M_S2
    if least_n <= most_n:
        return
    low_n, high_n = np.percentile(np.linalg.norm(raw.data[:, :3], axis=1), [0.0, 100.0])
    yield Finding(
        kind=ALWAYS_LOADED,
        severity="defect",
        start_ns=int(raw.t[0]),
        stop_ns=int(raw.t[-1]) + 1,
        columns=raw.signal.columns[:3],
        evidence=f"the force is never free of load: its norm stays between {low_n:.3g} and {high_n:.3g} N, and "
        f"bias and payload make {most_n:.3g} N at most; so the bias cannot be estimated from this recording",
        samples=len(raw),
    )
