"""Where a contact really begins: the sample at which the unfiltered force leaves its rest.

A threshold is crossed late by whoever touches gently, and a filter without lag sees a blow before it falls. So the
beginning is sought in the reading itself: of all samples around the crossing, that one from which on a rise explains
the force best, straight as against something hard or bent as against something that gives way, with rest before it (a
change point, by least squares).
"""

import numpy as np
from jaxtyping import Float

from wrenchflow.compiled import kernel
from wrenchflow.episode import Event, Stream
from wrenchflow.process.thresholds import Thresholds

_BEFORE_S, _AFTER_S = 0.1, 0.003  # Of rest before the force leaves the noise; and of the rise after it has come.
_RISE_S = 0.03  # By how much a filter without lag may see a blow before it falls.
_LONGEST_S = 1.0  # A rise that takes longer has no beginning that anybody could point at.
_PUSH_S = 0.02  # After the crossing the push has found its direction.
_RISEN = 1.5  # Times the noise: below it the filtered force counts as rest.


@kernel
def _change_point(force, first, last):
    """Index from which on rest turns into a rise, among first..last - 1, by the smallest squared error."""
    n = force.shape[0]
    best, best_at = np.inf, first
    rest_sum, rest_squares = 0.0, 0.0
    for i in range(first):
        rest_sum += force[i]
        rest_squares += force[i] * force[i]
    for at in range(first, last):
        rest = rest_sum / at
        # force = rest + slope * step, or rest + slope * step squared, from `at` on.
        squares, along, length, bent_along, bent_length = 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(at, n):
            step = i - at + 1.0
            value = force[i] - rest
            squares += value * value
            along += step * value
            length += step * step
            bent_along += step * step * value
            bent_length += step * step * step * step
        explained = max(along * along / length, bent_along * bent_along / bent_length)
        error = rest_squares - at * rest * rest + squares - explained
        if error < best:
            best, best_at = error, at
        rest_sum += force[at]
        rest_squares += force[at] * force[at]
    return best_at


def refine_onsets(
    contacts: tuple[Event, ...],
    unfiltered: Stream,
    labels: Stream,
    thresholds: Thresholds,
    rate_hz: float,
    delay_s: float,
) -> tuple[Event, ...]:
    """Move the start of each contact to where the force leaves its rest.

    Args:
        contacts: As the thresholds place them, in order.
        unfiltered: Wrench without bias, weight and inertia, and without a low-pass; at the stamps of `labels`.
        labels: `wrench_zero_phase`.
        thresholds: By which they were placed.
        rate_hz: Of both streams [Hz].
        delay_s: By which the sensor itself lags behind a slow force [s].

    Returns:
        The same contacts; none begins before the one before it has ended.
    """
    norm_n = np.linalg.norm(labels.data[:, :3], axis=1)
    refined: list[Event] = []
    for contact in contacts:
        crossing = int(np.searchsorted(labels.t, contact.start_ns))
        earliest_ns = refined[-1].stop_ns if refined else int(labels.t[0])
        earliest = int(np.searchsorted(labels.t, earliest_ns))
        at = _onset(unfiltered.data[:, :3], norm_n, crossing, earliest, thresholds, rate_hz)
        start_ns = int(labels.t[at]) - round(delay_s * 1e9)
        refined.append(Event(max(start_ns, earliest_ns), contact.stop_ns, contact.kind, contact.label))
    return tuple(refined)


def _onset(
    force: Float[np.ndarray, "n 3"],
    norm_n: Float[np.ndarray, " n"],
    crossing: int,
    earliest: int,
    thresholds: Thresholds,
    rate_hz: float,
) -> int:
    """Row at which a contact that was noticed at row `crossing` begins."""
    longest, before = round(_LONGEST_S * rate_hz), round(_BEFORE_S * rate_hz)
    after = max(round(_AFTER_S * rate_hz), 2)
    lowest = max(crossing - longest, earliest)
    calm = np.flatnonzero(norm_n[lowest:crossing] < _RISEN * thresholds.noise_n)
    risen = lowest + int(calm[-1]) if len(calm) else lowest
    first = max(risen - before, earliest)
    if risen - first < 4:
        return crossing  # It follows on another contact, or on a gap: there is no rest to leave.
    # Along the direction in which it will push.
    rest = force[first:risen].mean(axis=0)
    push = force[crossing : crossing + max(round(_PUSH_S * rate_hz), 2)].mean(axis=0) - rest
    length = float(np.linalg.norm(push))
    if length == 0.0:
        return crossing
    push /= length
    come = np.flatnonzero((force[crossing : crossing + round(_RISE_S * rate_hz)] - rest) @ push >= thresholds.on_n)
    stop = min(crossing + (int(come[0]) if len(come) else 0) + after, len(force))
    along = force[first:stop] @ push
    return first + int(_change_point(along, (risen - first) // 2, len(along) - 1))
