"""Contact from force and moment: hysteresis and a minimum dwell, so that noise at a threshold makes no contacts."""

import numpy as np
from jaxtyping import Bool

from wrenchflow.episode import Event, Stream
from wrenchflow.process.stamps import segments
from wrenchflow.process.thresholds import Thresholds

CONTACT = "contact"


def find_contacts(wrench: Stream, rate_hz: float, thresholds: Thresholds) -> tuple[Event, ...]:
    """Segment a filtered wrench (or force) into contacts.

    Args:
        wrench: Bias and weight taken out; `wrench_zero_phase` places the edges without lag.
        rate_hz: Of its samples [Hz].
        thresholds: Where contact begins and ends.

    Returns:
        Contacts in order, each from its first sample to the end of its last; none reaches over a gap.
    """
    period_ns = round(1e9 / rate_hz)
    on, off = _beyond(wrench, thresholds)
    dwell = thresholds.min_dwell_s * rate_hz
    contacts = []
    for run in segments(wrench.t, rate_hz):
        t = wrench.t[run]
        touching = without_short(hysteresis(on[run], off[run]), False, dwell)
        touching = without_short(touching, True, dwell)
        for first, last in runs_of(touching, True):
            stop_ns = int(t[last]) if last < len(t) else int(t[-1]) + period_ns
            contacts.append(Event(int(t[first]), stop_ns, CONTACT))
    return tuple(contacts)


def _beyond(wrench: Stream, thresholds: Thresholds) -> tuple[Bool[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
    """Whether each sample is at or above an `on`, and whether it is below each `off`."""
    force_n = np.linalg.norm(wrench.data[:, :3], axis=1)
    on, off = force_n >= thresholds.on_n, force_n < thresholds.off_n
    if thresholds.on_nm is not None and thresholds.off_nm is not None:
        moment_nm = np.linalg.norm(wrench.data[:, 3:], axis=1)
        on, off = on | (moment_nm >= thresholds.on_nm), off & (moment_nm < thresholds.off_nm)
    return on, off


def in_contact(wrench: Stream, contacts: tuple[Event, ...], margin_ns: int = 0) -> Bool[np.ndarray, " n"]:
    """Whether each sample lies in a contact, or within `margin_ns` of one. Shape (n,)."""
    inside = np.zeros(len(wrench), bool)
    for event in contacts:
        first, last = np.searchsorted(wrench.t, [event.start_ns - margin_ns, event.stop_ns + margin_ns])
        inside[first:last] = True
    return inside


def hysteresis(on: Bool[np.ndarray, " n"], off: Bool[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    """Between the thresholds the last decision holds; free before the first."""
    last = np.maximum.accumulate(np.where(on | off, np.arange(len(on)), -1))
    return (last >= 0) & on[last]


def runs_of(flags: Bool[np.ndarray, " n"], value: bool) -> list[tuple[int, int]]:
    """First and one past the last index of each run of `value`."""
    edges = np.diff(np.concatenate([[False], flags == value, [False]]).astype(np.int8))
    return list(zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True))


def without_short(flags: Bool[np.ndarray, " n"], value: bool, shortest: float) -> Bool[np.ndarray, " n"]:
    """Turn over the runs of `value` that are shorter than `shortest` samples; of free runs, the inner ones only."""
    kept = flags.copy()
    for first, last in runs_of(flags, value):
        if last - first < shortest and (value or (first > 0 and last < len(flags))):
            kept[first:last] = not value
    return kept
