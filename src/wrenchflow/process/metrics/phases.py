"""The figures of each phase of an episode."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from wrenchflow.episode import Episode
from wrenchflow.process.assessment import PhaseQuality
from wrenchflow.process.finding import NotAssessed
from wrenchflow.process.metric import Value
from wrenchflow.process.metrics.figure import Figure, is_finite
from wrenchflow.process.metrics.force import Felt, force_figures
from wrenchflow.process.metrics.motion import motion_figures

PHASE_NAMES = (
    "duration_s",
    "contact_fraction",
    "max_force",
    "max_torque",
    "smoothness",
    "force_rate_rms",
    "sparc",
    "ldlj",
    "path_length_m",
    "idle_fraction",
)

_NOTHING = "no sample of it is left, or it comes to no finite number"


def phase_figures(clean: Episode, felt: Felt, moved: tuple[np.ndarray, np.ndarray] | str) -> Iterator[PhaseQuality]:
    """Figures of every phase that a clean episode names, in order.

    Args:
        clean: The episode.
        felt: Its force.
        moved: What `velocity` says of it.
    """
    zero_ns = clean.span_ns[0]
    for phase in clean.events_of("phase"):
        start, stop = phase.start_ns, phase.stop_ns
        part = _felt_between(felt, start, stop)
        figures: list[Figure] = [("duration_s", (stop - start) * 1e-9)]
        figures += force_figures(part)
        if len(part.touching):
            figures.append(("contact_fraction", float(part.touching.mean())))
        if not isinstance(moved, str):
            t, rows = moved
            first, last = np.searchsorted(t, [start, stop])
            figures += motion_figures((t[first:last], rows[first:last]))
        values: dict[str, Value] = dict.fromkeys(PHASE_NAMES)
        told = {
            figure[0]: figure[1] for figure in figures if not isinstance(figure, NotAssessed) and is_finite(figure[1])
        }
        reasons = {figure.kind: figure.reason for figure in figures if isinstance(figure, NotAssessed)}
        yield PhaseQuality(
            label=phase.label,
            start_s=(start - zero_ns) * 1e-9,
            stop_s=(stop - zero_ns) * 1e-9,
            values=values | {name: told[name] for name in PHASE_NAMES if name in told},
            why={name: reasons.get(name, _NOTHING) for name in PHASE_NAMES if name not in told},
        )


def _felt_between(felt: Felt, start_ns: int, stop_ns: int) -> Felt:
    first, last = np.searchsorted(felt.labels.t, [start_ns, stop_ns])
    return replace(
        felt,
        wrench=felt.wrench.between(start_ns, stop_ns),
        labels=felt.labels.between(start_ns, stop_ns),
        contacts=tuple(each for each in felt.contacts if each.start_ns < stop_ns and each.stop_ns > start_ns),
        touching=felt.touching[first:last],
        free=felt.free[first:last],
    )
