"""The page of one episode: what was found in it and where, its force over time, and all its figures."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from html import escape

from wrenchflow.episode import Episode, Event
from wrenchflow.errors import StreamError
from wrenchflow.pages.episode_plot import episode_figure
from wrenchflow.pages.page import link, page, section, table
from wrenchflow.pages.plot_block import plot_block, plot_library
from wrenchflow.process.assessment import Assessment
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.finding import Finding
from wrenchflow.process.metric import METRICS, Metric
from wrenchflow.process.report.energy_panel import energy_panel
from wrenchflow.process.report.phases_table import phases_section
from wrenchflow.process.report.shown import is_whole, place
from wrenchflow.process.report.spectrum import spectrum_figure
from wrenchflow.process.report.timing import streams_section
from wrenchflow.process.report.words import NOT_ASSESSED, advice, figure, name_of, outcome, prose, sign, verdict

LIBRARY = "plotly.min.js"
_PLOT = "force"
_POINTS = 800
_MARGIN = 0.5  # A place is shown with as much beside it, as a share of its length, and 50 ms at least.
_ANOMALY = "anomaly"


def episode_page(
    assessment: Assessment,
    raw: Episode | None,
    clean: Episode | None,
    config: ProcessConfig,
    *,
    report: str = "../report.html",
    previous: str = "",
    following: str = "",
) -> str:
    """The page of an episode; it takes `LIBRARY`, with what `library_script` returns, from beside it.

    Args:
        assessment: What is known of it.
        raw: As it was recorded; None if it could not be read.
        clean: With its force cleaned; None if that could not be.
        config: How it was processed.
        report: Relative path of the page of the folder.
        previous: That of the page of the episode before; empty for the first.
        following: That of the page of the episode after; empty for the last.
    """
    around = [
        link("← previous", previous) if previous else "",
        link("all episodes", report),
        link("next →", following) if following else "",
    ]
    tare_s = (assessment.zero_ns - raw.span_ns[0]) * 1e-9 if raw and raw.streams else 0.0
    return page(
        assessment.id,
        [
            f'<nav aria-label="Episodes">{" ".join(filter(None, around))}</nav>',
            _headline(assessment),
            _findings(assessment),
            _force(assessment, raw, clean, config),
            _figures(assessment),
            phases_section(assessment.phases, tare_s),
            _spectrum(raw, clean, config),
            streams_section(assessment.streams),
            _not_assessed(assessment),
            _notes(assessment.notes),
        ],
        f"wrenchflow process. {link('What the figures mean, and how they were processed', report)}.",
        library=LIBRARY,
    )


def library_script() -> str:
    """The script that all episode pages of a folder load from beside them."""
    return plot_library()


def _headline(assessment: Assessment) -> str:
    refused = (
        f'<p><span class="defect">✖\u00a0There is no clean recording of it:</span> {escape(assessment.refused)}</p>'
        if assessment.refused
        else ""
    )
    task = escape(assessment.task) or "not recorded"
    return (
        f"<h1>{escape(assessment.id)}</h1><p>{verdict(assessment)}. Task: {task}. "
        f"Outcome: {outcome(assessment.success)}.</p>{refused}"
    )


def _findings(assessment: Assessment) -> str:
    if not assessment.findings:
        return section("Findings", "<p><span class='good'>✓</span> Nothing was found.</p>")
    rows = [
        (
            sign(finding.severity, name_of(finding.kind)),
            _place(finding, assessment),
            escape(", ".join(finding.columns)) or "all columns",
            f'<td class="text">{escape(finding.evidence)}</td>',
        )
        for finding in assessment.findings
    ]
    todo = "".join(
        f"<li><b>{escape(name_of(kind))}:</b> {escape(advice(kind))}</li>"
        for kind in dict.fromkeys(finding.kind for finding in assessment.findings)
    )
    what = f"<p><b>What to do</b></p><ul>{todo}</ul>"
    return section(
        "Findings", f'<div class="group">{table(("what", "where", "columns", "evidence"), rows)}</div>', what
    )


def _place(finding: Finding, assessment: Assessment) -> str:
    text = escape(place(finding, assessment))
    if is_whole(finding, assessment):
        return text
    margin_ns = max(_MARGIN * (finding.stop_ns - finding.start_ns), 5e7)
    start_s, stop_s = (
        (at_ns - assessment.zero_ns) * 1e-9 for at_ns in (finding.start_ns - margin_ns, finding.stop_ns + margin_ns)
    )
    return (
        f'<a href="#{_PLOT}" data-plot="{_PLOT}" data-from="{start_s:.4f}" data-to="{stop_s:.4f}" '
        f'title="show it in the plot">{text}</a>'
    )


def _force(assessment: Assessment, raw: Episode | None, clean: Episode | None, config: ProcessConfig) -> str:
    title = "Force over time"
    episode = clean or raw
    if episode is None:
        return section(title, f"<p>{NOT_ASSESSED}: {escape(assessment.refused)}</p>")
    panel, lacking = energy_panel(clean, config.filter) if clean else (None, "there is no clean force")
    marked = replace(
        episode,
        events=(
            *(event for event in episode.events if event.kind != _ANOMALY),
            *(
                Event(each.start_ns, each.stop_ns, _ANOMALY, name_of(each.kind))
                for each in assessment.findings
                if not is_whole(each, assessment)
            ),
        ),
    )
    try:
        drawing = episode_figure(marked, "", points=_POINTS, more=[panel] if panel else [])
    except StreamError as error:
        return section(title, f"<p>{NOT_ASSESSED}: {escape(str(error))}</p>")
    said = (
        ""
        if clean
        else "<p>This is the reading as it came, drawn faintly: there is no clean force, for the reason above.</p>"
    )
    text = (
        "<p><small>Drag to zoom, double-click to go back. Orange is contact, red an anomaly; the lanes above name "
        "them. Lines are thinned to the smallest and the largest sample of each short stretch, so that no peak is lost."
        "</small></p>"
    )
    less = f"<p><small>Energy balance {NOT_ASSESSED}: {escape(lacking)}.</small></p>" if lacking else ""
    return section(title, said, text, plot_block(drawing, _PLOT), less)


def _spectrum(raw: Episode | None, clean: Episode | None, config: ProcessConfig) -> str:
    title = "Spectrum of the force"
    if raw is None:
        return section(title, f"<p>{NOT_ASSESSED}: the file cannot be read.</p>")
    drawing, lacking = spectrum_figure(raw, clean, config.filter.cutoff_hz)
    text = (
        "<p>Of the raw reading, its three forces together. What lies right of the cut-off the filter takes out; a line "
        "that stands up in free motion is vibration or mains.</p>"
    )
    less = "".join(f"<p><small>{NOT_ASSESSED}: {escape(each)}.</small></p>" for each in lacking)
    return section(title, text, plot_block(drawing, "spectrum") if drawing else "", less)


def _figures(assessment: Assessment) -> str:
    head = ("figure", "value", "meaning")
    first, others = (
        table(head, [_figure(metric, assessment) for metric in METRICS if metric.decides is decides])
        for decides in (True, False)
    )
    more = [
        f"<p>SNR by axis [dB]: {escape(_by_name(assessment.snr))}.</p>" if assessment.snr else "",
        f"<p>Bias of the sensor, by column [N, N.m]: {', '.join(f'{each:.4g}' for each in assessment.bias)}.</p>"
        if assessment.bias
        else "",
    ]
    fold = f"<details><summary>All other figures</summary><div>{others}{''.join(more)}</div></details>"
    return section("Figures that decide", f'<div class="group">{first}{fold}</div>')


def _figure(metric: Metric, assessment: Assessment) -> tuple[str, ...]:
    value = assessment[metric.name]
    # The whole reason stands below, once for all figures that it concerns.
    why = f": {escape(assessment.why_not(metric.name).partition(': ')[0])}" if value is None else ""
    meaning = f'<td class="text soft">{prose(metric.meaning)}</td>'
    return (f"<b>{escape(metric.title)}</b>", escape(figure(metric, value)) + why, meaning)


def _by_name(values: Mapping[str, float | None]) -> str:
    return ", ".join(f"{name} {NOT_ASSESSED if each is None else f'{each:.1f}'}" for name, each in values.items())


def _not_assessed(assessment: Assessment) -> str:
    if not assessment.not_assessed:
        return section("Not assessed", "<p>Everything was assessed.</p>")
    reasons: dict[str, list[str]] = {}
    for each in assessment.not_assessed:
        reasons.setdefault(each.reason, []).append(name_of(each.kind))
    items = "".join(
        f"<li>{escape(', '.join(names))}: <span class='soft'>{escape(reason)}</span></li>"
        for reason, names in reasons.items()
    )
    return section("Not assessed", f"<ul>{items}</ul>")


def _notes(notes: Sequence[str]) -> str:
    if not notes:
        return ""
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return section("What was assumed", f"<ul>{items}</ul>")
