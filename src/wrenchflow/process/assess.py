"""All that can be told of one episode: what the detectors find, and every metric, or why it cannot be told."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np

from wrenchflow.episode import Episode
from wrenchflow.errors import WrenchflowError
from wrenchflow.process.anomalies.detect import detect
from wrenchflow.process.assessment import Assessment
from wrenchflow.process.calibration import TARE
from wrenchflow.process.clean import Cleaned
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.contact import CONTACT, in_contact
from wrenchflow.process.drift import bias_drift
from wrenchflow.process.finding import Finding, NotAssessed
from wrenchflow.process.loaded import always_loaded
from wrenchflow.process.metric import METRICS, NAMES, Value
from wrenchflow.process.metrics.energy import energy_figures, work_of
from wrenchflow.process.metrics.figure import GUARD_NS, Figure, is_finite
from wrenchflow.process.metrics.force import Felt, contact_figures, force_figures, snr_by_axis
from wrenchflow.process.metrics.motion import motion_figures, velocity
from wrenchflow.process.metrics.phases import phase_figures
from wrenchflow.process.metrics.sensor import free_figures, reading_figures
from wrenchflow.process.metrics.timing import stream_timing, timing_figures
from wrenchflow.process.spread import POINTS
from wrenchflow.process.stamps import finite
from wrenchflow.rig import rig_of

REFUSED, NO_CONTACT, UNREADABLE = "no-clean-force", "no-contact", "unreadable"


def assess(episode: Episode, cleaned: Cleaned | WrenchflowError, config: ProcessConfig) -> Assessment:
    """Assess one episode.

    Args:
        episode: As it was recorded.
        cleaned: The clean episode, or why there is none.
        config: How it was processed.
    """
    # The page and the table name the episode themselves.
    refused = str(cleaned).removeprefix(f"episode {episode.id}: ") if isinstance(cleaned, WrenchflowError) else ""
    timings = [stream_timing(name, stream) for name, stream in sorted(episode.streams.items())]
    findings, unknown = _detect(episode, None if isinstance(cleaned, WrenchflowError) else cleaned)
    figures: list[Figure] = list(_raw_figures(episode, timings, findings))
    moved = velocity(episode)
    figures += motion_figures(moved)
    known: dict[str, Any] = {}
    if isinstance(cleaned, WrenchflowError):
        findings.insert(0, _refusal(episode, refused))
        findings += always_loaded(episode, config)
    else:
        felt = Felt.of(cleaned.episode, cleaned.rate_hz)
        figures += _clean_figures(cleaned, felt, config)
        if not felt.contacts and config.expects_contact:
            findings.append(_no_contact(episode, felt, cleaned))
        known = {
            "snr": snr_by_axis(felt),
            "bias": tuple(cleaned.bias.mean.tolist()),
            "phases": tuple(phase_figures(cleaned.episode, felt, moved)),
            "curve": _curve(felt),
            "contact_start_m": _contact_start_m(cleaned.episode, felt),
        }
    values, why = _sorted_out(figures, refused)
    return Assessment(
        id=episode.id,
        task=episode.task,
        success=_success(episode.meta),
        refused=refused,
        values=values,
        findings=tuple(findings),
        not_assessed=(*unknown, *why),
        streams=tuple(timings),
        notes=_notes(episode.meta),
        zero_ns=_zero_ns(episode),
        **known,
    )


def unreadable(id: str, error: WrenchflowError) -> Assessment:
    """What can be said of a file that is no recording."""
    finding = Finding(kind=UNREADABLE, severity="defect", start_ns=0, stop_ns=0, columns=(), evidence=str(error))
    reason = "the file cannot be read"
    return Assessment(
        id=id,
        task="",
        refused=str(error),
        findings=(finding,),
        not_assessed=tuple(NotAssessed(kind=name, reason=reason) for name in NAMES),
    )


def _detect(episode: Episode, cleaned: Cleaned | None) -> tuple[list[Finding], list[NotAssessed]]:
    if "wrench_raw" not in episode:
        return [], [NotAssessed(kind="anomalies", reason="there is no stream 'wrench_raw'")]
    episode = cleaned.episode if cleaned else episode  # Its rig has the payload of a calibration, where there is one.
    try:
        rig = rig_of(episode.meta, "its metadata")
    except WrenchflowError as error:
        return [], [NotAssessed(kind="anomalies", reason=str(error))]
    raw = finite(episode["wrench_raw"])
    # Where contact cannot be told nothing counts as free, and a detector falls back on what the whole reading shows.
    free = ~in_contact(raw, cleaned.episode.events_of(CONTACT), GUARD_NS) if cleaned else np.zeros(len(raw), bool)
    return detect(episode, rig, free)


def _raw_figures(episode: Episode, timings: Iterable[Any], findings: list[Finding]) -> Iterator[Figure]:
    timing = next((each for each in timings if each.name == "wrench_raw"), None)
    if timing is None:
        return
    yield from timing_figures(episode, timing)
    yield from reading_figures(finite(episode["wrench_raw"]), findings)


def _clean_figures(cleaned: Cleaned, felt: Felt, config: ProcessConfig) -> Iterator[Figure]:
    yield from force_figures(felt)
    yield from contact_figures(felt, _zero_ns(cleaned.episode))
    yield from free_figures(felt, cleaned.bias.std)
    yield _drift(cleaned, felt, config)
    yield from energy_figures(work_of(cleaned.episode, felt, config.filter))


def _drift(cleaned: Cleaned, felt: Felt, config: ProcessConfig) -> Figure:
    rig = rig_of(cleaned.episode.meta, "its metadata")
    found = bias_drift(cleaned.episode, rig, cleaned.bias, felt.contacts, config=config.bias)
    if isinstance(found, NotAssessed):
        return NotAssessed(kind="bias_drift", reason=found.reason)
    return "bias_drift", float(np.abs(found.slope_per_min[:3]).max())


def _sorted_out(figures: Iterable[Figure], refused: str) -> tuple[Mapping[str, Value], list[NotAssessed]]:
    """Every metric with its value, and a reason for each that has none."""
    values: dict[str, Value] = dict.fromkeys(NAMES)
    why: dict[str, str] = {}
    for figure in figures:
        if isinstance(figure, NotAssessed):
            why[figure.kind] = figure.reason
        else:
            values[figure[0]] = figure[1]
    for name, value in values.items():
        if value is not None and not is_finite(value):
            values[name], why[name] = None, "it comes to no finite number"
    missing = [metric for metric in METRICS if values[metric.name] is None]
    default = f"there is no clean force: {refused}" if refused else "there is no stream 'wrench_raw'"
    return values, [NotAssessed(kind=each.name, reason=why.get(each.name, default)) for each in missing]


def _refusal(episode: Episode, refused: str) -> Finding:
    start_ns, stop_ns = episode.span_ns
    return Finding(kind=REFUSED, severity="defect", start_ns=start_ns, stop_ns=stop_ns, columns=(), evidence=refused)


def _no_contact(episode: Episode, felt: Felt, cleaned: Cleaned) -> Finding:
    start_ns, stop_ns = episode.span_ns
    largest_n, needed_n = _largest_n(felt), cleaned.thresholds.on_n
    return Finding(
        kind=NO_CONTACT,
        # A success is a witness that the tool was there: then the touch was too light to be told, and nothing is lost.
        severity="warning" if _success(cleaned.episode.meta) else "defect",
        start_ns=start_ns,
        stop_ns=stop_ns,
        columns=(),
        evidence=f"no force makes a contact: {largest_n:.2g} N at most, expected {needed_n:.2g} N for "
        "longer than a moment",
    )


def _largest_n(felt: Felt) -> float:
    return float(np.linalg.norm(felt.labels.data[:, :3], axis=1).max(initial=0.0))


def _zero_ns(episode: Episode) -> int:
    tare = next((event for event in episode.events_of("phase") if event.label == TARE), None)
    return tare.stop_ns if tare else episode.span_ns[0]


def _curve(felt: Felt) -> tuple[float, ...]:
    if not felt.contacts:
        return ()
    t = np.linspace(felt.contacts[0].start_ns, felt.contacts[-1].stop_ns, POINTS)
    norm_n = np.linalg.norm(felt.labels.data[:, :3], axis=1)
    curve = np.interp(t, felt.labels.t, norm_n)
    return tuple(curve.tolist()) if np.isfinite(curve).all() else ()


def _contact_start_m(episode: Episode, felt: Felt) -> tuple[float, float, float] | None:
    if not felt.contacts:
        return None
    at_ns, pose = felt.contacts[0].start_ns, episode["tcp_pose"]
    place = pose.data[max(int(np.searchsorted(pose.t, at_ns, side="right")) - 1, 0), :3]
    goal = episode.streams.get("goal_pose")
    if goal is not None and len(goal) and goal.frame == pose.frame:
        place = place - goal.data[max(int(np.searchsorted(goal.t, at_ns, side="right")) - 1, 0), :3]
    x, y, z = place.tolist()
    return (x, y, z)


def _success(meta: Mapping[str, Any]) -> bool | None:
    result = meta.get("result")
    success = result.get("success") if isinstance(result, Mapping) else None
    return success if isinstance(success, bool) else None


def _notes(meta: Mapping[str, Any]) -> tuple[str, ...]:
    """What the import of a foreign recording had to assume."""
    imported = meta.get("import")
    notes = imported.get("notes", ()) if isinstance(imported, Mapping) else ()
    return tuple(str(note) for note in notes)
