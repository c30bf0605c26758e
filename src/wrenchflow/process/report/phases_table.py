"""Figures of each phase of an episode side by side, with bars where smoothness is compared."""

from collections.abc import Sequence
from html import escape

from wrenchflow.pages.page import NBSP, section, table
from wrenchflow.process.assessment import PhaseQuality
from wrenchflow.process.metric import METRICS, Metric
from wrenchflow.process.report.words import NOT_ASSESSED, figure, with_unit

_BARS = ("smoothness", "force_rate_rms", "sparc", "ldlj")


def phases_section(phases: Sequence[PhaseQuality], tare_s: float) -> str:
    """A row a phase.

    Args:
        phases: In order.
        tare_s: From the first stamp to where time counts from [s].
    """
    if not phases:
        return section("Phases", f"<p>{NOT_ASSESSED}: no phase is known, or there is no clean force.</p>")
    known = {name for phase in phases for name in (*phase.values, *phase.why)}
    metrics = [metric for metric in METRICS if metric.name in known]
    rows = [
        (
            escape(phase.label) or "unnamed",
            f"{phase.start_s - tare_s:.2f}{NBSP}s",
            *(_cell(metric, phase, phases) for metric in metrics),
        )
        for phase in phases
    ]
    head = ("phase", "from", *(with_unit(metric.name) for metric in metrics))
    text = "<p>Bars compare the phases: a longer one is less smooth.</p>"
    return section("Phases and smoothness", text, table(head, rows), _reasons(phases))


def _cell(metric: Metric, phase: PhaseQuality, phases: Sequence[PhaseQuality]) -> str:
    value = phase.values.get(metric.name)
    if value is None:
        return f'<td class="soft" title="{escape(phase.why.get(metric.name, ""))}">{NOT_ASSESSED}</td>'
    text = escape(figure(metric, value, unit=False))
    if metric.name not in _BARS:
        return f"<td>{text}</td>"
    sizes = [abs(float(each)) for other in phases if (each := other.values.get(metric.name)) is not None]
    share = 100.0 * abs(float(value)) / (max(sizes) or 1.0)
    return (
        f'<td>{text}<svg class="share" viewBox="0 0 100 5" preserveAspectRatio="none" aria-hidden="true">'
        f'<rect width="{share:.1f}" height="5"/></svg></td>'
    )


def _reasons(phases: Sequence[PhaseQuality]) -> str:
    reasons: dict[tuple[str, str], list[str]] = {}
    for phase in phases:
        for name, why in phase.why.items():
            reasons.setdefault((phase.label, why), []).append(with_unit(name))
    items = "".join(
        f"<li>{escape(label)}: {escape(', '.join(names))}: {escape(why)}</li>"
        for (label, why), names in reasons.items()
    )
    return f"<details><summary>Why some are {NOT_ASSESSED}</summary><ul>{items}</ul></details>" if items else ""
