"""Contact from force: hysteresis and a minimum dwell, so that noise at a threshold makes no contacts."""

import numpy as np
from jaxtyping import Bool, Float

from wrenchflow.episode import Event, Stream
from wrenchflow.errors import ConfigError
from wrenchflow.process.config import ContactConfig
from wrenchflow.process.stamps import segments
from wrenchflow.rig import Rig

CONTACT = "contact"
# Both thresholds stand at least this many standard deviations of the unfiltered force above zero. The low-pass halves
# the noise, so the off threshold is some six of what is left.
NOISE_MARGIN = 3.0


def find_contacts(wrench: Stream, rig: Rig, config: ContactConfig | None = None) -> tuple[Event, ...]:
    """Segment a filtered wrench (or force) into contacts.

    Args:
        wrench: Bias and weight taken out; `wrench_zero_phase` places the edges without lag.
        rig: Noise and rate of the sensor.
        config: Thresholds.

    Returns:
        Contacts in order, each from its first sample to the end of its last; none reaches over a gap.

    Raises:
        ConfigError: If the thresholds lie within the sensor's noise.
    """
    config = config or ContactConfig()
    floor_n = NOISE_MARGIN * rig.sensor.noise_force_n
    if config.off_n < floor_n:
        raise ConfigError(
            f"contact.off_n must stand above the noise of sensor '{rig.sensor.name}': got {config.off_n:g} N, "
            f"expected {floor_n:g} N at least ({NOISE_MARGIN:g} standard deviations)."
        )
    period_ns = round(1e9 / rig.sensor.rate_hz)
    force_n = np.linalg.norm(wrench.data[:, :3], axis=1)
    contacts = []
    for run in segments(wrench.t, rig.sensor.rate_hz):
        t = wrench.t[run]
        dwell = config.min_dwell_s * rig.sensor.rate_hz
        touching = _without_short(_hysteresis(force_n[run], config.on_n, config.off_n), False, dwell)
        touching = _without_short(touching, True, dwell)
        for first, last in _runs(touching, True):
            stop_ns = int(t[last]) if last < len(t) else int(t[-1]) + period_ns
            contacts.append(Event(int(t[first]), stop_ns, CONTACT))
    return tuple(contacts)


def in_contact(wrench: Stream, contacts: tuple[Event, ...], margin_ns: int = 0) -> Bool[np.ndarray, " n"]:
    """Whether each sample lies in a contact, or within `margin_ns` of one. Shape (n,)."""
    inside = np.zeros(len(wrench), bool)
    for event in contacts:
        first, last = np.searchsorted(wrench.t, [event.start_ns - margin_ns, event.stop_ns + margin_ns])
        inside[first:last] = True
    return inside


def _hysteresis(force_n: Float[np.ndarray, " n"], on_n: float, off_n: float) -> Bool[np.ndarray, " n"]:
    """Between the thresholds the last decision holds; free before the first."""
    decided = (force_n >= on_n) | (force_n < off_n)
    last = np.maximum.accumulate(np.where(decided, np.arange(len(force_n)), -1))
    return (last >= 0) & (force_n[last] >= on_n)


def _runs(flags: Bool[np.ndarray, " n"], value: bool) -> list[tuple[int, int]]:
    """First and one past the last index of each run of `value`."""
    edges = np.diff(np.concatenate([[False], flags == value, [False]]).astype(np.int8))
    return list(zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True))


def _without_short(flags: Bool[np.ndarray, " n"], value: bool, shortest: float) -> Bool[np.ndarray, " n"]:
    """Turn over the runs of `value` that are shorter than `shortest` samples; of free runs, the inner ones only."""
    kept = flags.copy()
    for first, last in _runs(flags, value):
        if last - first < shortest and (value or (first > 0 and last < len(flags))):
            kept[first:last] = not value
    return kept
