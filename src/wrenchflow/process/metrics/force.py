"""How strong, how clear and how smooth the force is, and how much of it is contact."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.process.contact import CONTACT, in_contact
from wrenchflow.process.finding import NotAssessed
from wrenchflow.process.metrics.figure import GUARD_NS, Figure, too_few
from wrenchflow.process.stamps import segments

_IMPACT_NS = 50_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Felt:
    """The clean force of an episode, and where it is contact.

    Attributes:
        wrench: Causal.
        labels: Zero-phase, at the same stamps.
        contacts: In order.
        touching: Whether each sample lies in a contact. Shape (n,).
        free: Whether it lies well away from any. Shape (n,).
        rate_hz: Of the sensor [Hz].
    """

    wrench: Stream
    labels: Stream
    contacts: tuple[Event, ...]
    touching: Bool[np.ndarray, " n"]
    free: Bool[np.ndarray, " n"]
    rate_hz: float

    @classmethod
    def of(cls, clean: Episode, rate_hz: float) -> "Felt":
        """That of a clean episode."""
        labels, contacts = clean["wrench_zero_phase"], clean.events_of(CONTACT)
        return cls(
            wrench=clean["wrench"],
            labels=labels,
            contacts=contacts,
            touching=in_contact(labels, contacts),
            free=~in_contact(labels, contacts, GUARD_NS),
            rate_hz=rate_hz,
        )


def force_figures(felt: Felt) -> Iterator[Figure]:
    """Strength, signal-to-noise and smoothness."""
    yield from snr_figures(felt)
    force = felt.wrench.data[:, :3]
    if not len(force):
        yield NotAssessed(kind="max_force", reason="no sample is left")
    else:
        yield "max_force", float(_norm(force).max())
    if felt.wrench.data.shape[1] < 6:
        yield NotAssessed(kind="max_torque", reason="a force sensor reads no moments")
    elif len(force):
        yield "max_torque", float(_norm(felt.wrench.data[:, 3:]).max())
    steps_n, inside = force_steps(felt)
    if not len(steps_n):
        for name in ("smoothness", "max_force_rate", "force_rate_rms"):
            yield NotAssessed(kind=name, reason=f"{len(force)} samples, 2 in a row needed")
        return
    yield "smoothness", float(steps_n.mean())
    yield "max_force_rate", float(steps_n.max()) * felt.rate_hz
    reason = too_few(contact=felt.touching)
    if reason or not inside.any():
        yield NotAssessed(kind="force_rate_rms", reason=reason or "no contact lasts for two samples")
    else:
        yield "force_rate_rms", float(np.sqrt((steps_n[inside] ** 2).mean())) * felt.rate_hz


def snr_by_axis(felt: Felt) -> dict[str, float | None]:
    """Signal-to-noise of each axis [dB]; None where it cannot be told."""
    known = not too_few(contact=felt.touching, free_motion=felt.free)
    names = felt.labels.signal.columns
    return {name: _snr_db(felt, [axis]) if known else None for axis, name in enumerate(names)}


def snr_figures(felt: Felt) -> Iterator[Figure]:
    """Signal-to-noise of the forces, and of the moments."""
    reason = too_few(contact=felt.touching, free_motion=felt.free)
    width = felt.labels.data.shape[1]
    for name, axes in (("snr_force_db", [0, 1, 2]), ("snr_torque_db", [3, 4, 5])):
        why = "a force sensor reads no moments" if axes[-1] >= width else reason
        value = None if why else _snr_db(felt, axes)
        if value is None:
            yield NotAssessed(kind=name, reason=why or "the reading is zero throughout, or beyond any number")
        else:
            yield name, value


def contact_figures(felt: Felt, zero_ns: int) -> Iterator[Figure]:
    """How many contacts, how much of them, when the first, and how hard they begin.

    Args:
        felt: The force.
        zero_ns: Where time counts from: the end of the tare [ns].
    """
    yield "has_contact", bool(felt.contacts)
    yield "contacts", len(felt.contacts)
    if len(felt.touching):
        yield "contact_fraction", float(felt.touching.mean())
    else:
        yield NotAssessed(kind="contact_fraction", reason="no sample is left")
    if not felt.contacts:
        for name in ("contact_onset_s", "impact_peak"):
            yield NotAssessed(kind=name, reason="there is no contact")
        return
    yield "contact_onset_s", (felt.contacts[0].start_ns - zero_ns) * 1e-9
    norm_n = _norm(felt.labels.data[:, :3])
    peaks_n = []
    for event in felt.contacts:
        first, last = np.searchsorted(felt.labels.t, [event.start_ns, min(event.start_ns + _IMPACT_NS, event.stop_ns)])
        peaks_n.append(norm_n[first:last].max(initial=0.0))
    yield "impact_peak", float(max(peaks_n))


def force_steps(felt: Felt) -> tuple[Float[np.ndarray, " m"], Bool[np.ndarray, " m"]]:
    """Norm of the force's change from each sample to the next [N], none over a gap; and whether it lies in contact."""
    steps, inside = [], []
    for run in segments(felt.labels.t, felt.rate_hz):
        steps.append(_norm(np.diff(felt.labels.data[run, :3], axis=0)))
        inside.append(felt.touching[run][1:] & felt.touching[run][:-1])
    return (np.concatenate(steps), np.concatenate(inside)) if steps else (np.empty(0), np.empty(0, bool))


def _norm(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    return np.sqrt(np.einsum("ij,ij->i", vectors, vectors))


def _snr_db(felt: Felt, axes: list[int]) -> float | None:
    data = felt.labels.data[:, axes]
    signal, noise = (float(np.sqrt((data[rows] ** 2).mean())) for rows in (felt.touching, felt.free))
    if not (0.0 < signal < np.inf and 0.0 < noise < np.inf):
        return None
    return 20.0 * float(np.log10(signal / noise))
