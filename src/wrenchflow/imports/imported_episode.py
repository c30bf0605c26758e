"""One take and its mapping to a raw episode, with all that was assumed and could be estimated beside it."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from wrenchflow.config import to_mapping
from wrenchflow.episode import Episode, Stream
from wrenchflow.errors import RecordingError
from wrenchflow.imports.estimates import RateEstimate, estimate_rate, figures_of
from wrenchflow.imports.mapping import ImportMapping
from wrenchflow.imports.streams import import_stream
from wrenchflow.imports.take import Take
from wrenchflow.rig import Rig


def import_take(take: Take, mapping: ImportMapping, rig: Rig | None, where: str, files: Mapping[str, str]) -> Episode:
    """Make an episode.

    Args:
        take: What it is made from.
        mapping: What its numbers mean.
        rig: The robot cell; None if nothing is known of it.
        where: Name of the mapping, for messages.
        files: SHA-256 of the source's files by name; one for a file, several for a bag.

    Returns:
        The episode. `meta["import"]` has the source, the mapping, assumptions, estimates and notes.

    Raises:
        RecordingError: If the take does not hold what the mapping says.
        ConfigError: If the mapping leaves out what the take shows to be needed.
    """
    streams: dict[str, Stream] = {}
    notes, dropped = list(mapping.assumptions), {}
    for name, stream in mapping.streams.items():
        clock = mapping.clock_of(stream)
        done = import_stream(take, name, stream, clock, f"{where}.streams.{name}")
        if done.name in streams:
            raise RecordingError(f"{where}.streams.{name}: there is another stream '{done.name}'.")
        streams[done.name] = done.stream
        dropped[done.name] = done.dropped
        notes += done.notes
    streams = _begun_at_zero(streams, notes)
    assumed_hz = {
        clock.rate_hz
        for stream in mapping.streams.values()
        if (clock := mapping.clock_of(stream)).rate_hz is not None and not stream.topic
    }
    rate = estimate_rate(streams) if assumed_hz else None
    notes += [_rate_note(hz, rate) for hz in sorted(assumed_hz)]
    if rig is None:
        notes.append("No rig is stated: where the sensor sits, how it reads and what hangs on it is not known.")
    estimates: dict[str, Any] = {"streams": {name: to_mapping(figures_of(each)) for name, each in streams.items()}}
    if rate is not None:
        estimates["rate"] = to_mapping(rate)
    about = {
        "source": {"files": dict(files), "take": take.id},
        "mapping": to_mapping(mapping),
        "assumptions": {"rate_hz": sorted(assumed_hz), "stated": list(mapping.assumptions)},
        "estimates": estimates,
        "dropped": {name: count for name, count in dropped.items() if count},
        "notes": notes,
    }
    meta = {"import": about} | ({"rig": to_mapping(rig)} if rig is not None else {})
    return Episode(take.id, mapping.task, streams, meta=meta)


def _begun_at_zero(streams: dict[str, Stream], notes: list[str]) -> dict[str, Stream]:
    """A recording's clock shows no time below zero: move all streams together where one begins there."""
    first_ns = min((int(stream.t[0]) for stream in streams.values() if len(stream)), default=0)
    if first_ns >= 0:
        return streams
    notes.append(f"Stamps begin at {first_ns * 1e-9:.9g} s: all were moved, so that the first is 0.")
    return {name: replace(stream, t=stream.t - first_ns) for name, stream in streams.items()}


def _rate_note(assumed_hz: float, rate: RateEstimate | None) -> str:
    assumed = f"The file has no clock: {assumed_hz:g} Hz ({1e3 / assumed_hz:.4g} ms a sample) are assumed"
    if rate is None:
        return f"{assumed}, and there is no velocity beside a position to estimate the rate from."
    axes = ", ".join(
        f"{step_ms:.3g} ms in {axis} (R^2 {fit:.2f})"
        for axis, step_ms, fit in zip("xyz", rate.step_ms, rate.r_squared, strict=True)
        if step_ms is not None and fit is not None
    )
    if rate.rate_hz is None:
        return (
            f"{assumed}; integrating '{rate.velocity}' against '{rate.position}' tells no rate: {axes or 'no motion'}."
        )
    return (
        f"{assumed}, but integrating '{rate.velocity}' against '{rate.position}' gives {1e3 / rate.rate_hz:.3g} ms a "
        f"sample, about {rate.rate_hz:.0f} Hz: {axes}."
    )
