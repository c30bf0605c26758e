"""The page that a person opens after `process`: what is wrong first, then how the episodes compare."""

from collections.abc import Sequence
from html import escape

from wrenchflow.pages.page import NBSP, card, cards, page
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.data_set import DataSetQuality
from wrenchflow.process.metric import METRICS, metric_of
from wrenchflow.process.report.episode_table import episodes_section
from wrenchflow.process.report.faults import findings_section, not_assessed_section
from wrenchflow.process.report.meanings import meanings_section, processing_section
from wrenchflow.process.report.script import SCRIPT
from wrenchflow.process.report.shown import Shown
from wrenchflow.process.report.spread_plots import curves_section
from wrenchflow.process.report.strips import distributions_section, unusual_section
from wrenchflow.process.report.timing import timing_section
from wrenchflow.process.report.words import NOT_ASSESSED, count, figure

_NAMES = (
    ("defects", "Defects"),
    ("warnings", "Warnings"),
    ("not-assessed", "Not assessed"),
    ("distributions", "Distributions"),
    ("unusual", "Unusual"),
    ("curves", "Force curves"),
    ("all", "Episodes"),
    ("timing", "Timing"),
    ("meanings", "Meanings"),
    ("settings", "Settings"),
)


def folder_page(quality: DataSetQuality, config: ProcessConfig, *, pages: Sequence[str] = ()) -> str:
    """The report of a folder, self-contained.

    Args:
        quality: All episodes.
        config: How they were processed.
        pages: Relative path of each episode's page, in the order of the assessments; none are linked without it.
    """
    shown = Shown(assessments=quality.assessments, pages=pages)
    sections = (
        findings_section("Defects", ("defect",), shown, nothing="No episode has a defect."),
        findings_section("Warnings and notes", ("warning", "note"), shown, nothing="There are none."),
        not_assessed_section(quality, shown),
        distributions_section(quality, shown),
        unusual_section(quality, shown),
        curves_section(quality, shown),
        episodes_section(quality, shown),
        timing_section(shown),
        meanings_section(),
        processing_section(config),
    )
    links = " ".join(f'<a href="#{id}">{escape(name)}</a>' for id, name in _NAMES)
    return page(
        f"Force quality of {len(quality.assessments)} episodes",
        [
            _headline(quality),
            _cards(quality),
            f'<nav class="contents" aria-label="Contents">{links}</nav>',
            *(f'<div id="{id}">{body}</div>' for (id, _), body in zip(_NAMES, sections, strict=True)),
        ],
        "wrenchflow process. No grade is given: no figure of a single demonstration tells whether a policy learns from "
        "it.",
        script=SCRIPT,
    )


def _headline(quality: DataSetQuality) -> str:
    total, bad = len(quality.assessments), quality.defects
    said = (
        f"<b>{count(bad, 'episode')} of {total}</b> cannot be believed as they are, for the defects below."
        if bad
        else f"Nothing was found that decides against any of the {count(total, 'episode')}."
    )
    tasks = ", ".join(sorted({each.task for each in quality.assessments if each.task}))
    return f"<h1>Force quality</h1><p>{said}{f' Tasks: {escape(tasks)}.' if tasks else ''}</p>"


def _cards(quality: DataSetQuality) -> str:
    of = quality.assessments
    seconds = [each["duration_s"] for each in of if each["duration_s"] is not None]
    samples = [each["samples"] for each in of if each["samples"] is not None]
    known = [each.success for each in of if each.success is not None]
    touching = [each["has_contact"] for each in of if each["has_contact"] is not None]
    warned = sum(each.is_sound and each.count("warning") > 0 for each in of)
    lacking = sum(any(each[metric.name] is None for metric in METRICS if metric.decides) for each in of)
    strange = len({each.id for each in quality.unusual})
    peak, metric = quality.distributions.get("max_force"), metric_of("max_force")
    return cards(
        card("sound episodes", f"{len(of) - quality.defects} of {len(of)}", f"{warned} of them with warnings"),
        card("with defects", f"{quality.defects}", "listed first, with what to do"),
        card("data", f"{sum(seconds) / 60.0:.1f}{NBSP}min", f"{sum(samples):,} samples of force"),
        card(
            "outcome",
            f"{sum(known)} of {len(known)}" if known else NOT_ASSESSED,
            "attempts succeeded" if known else "no recording says what came of it",
        ),
        card(
            "contact",
            f"{sum(touching)} of {len(touching)}" if touching else NOT_ASSESSED,
            "episodes with a clean force touch" if touching else "no episode has a clean force",
        ),
        card(
            "largest force, median",
            figure(metric, peak.median) if peak else NOT_ASSESSED,
            f"{figure(metric, peak.low)} to {figure(metric, peak.high)}" if peak else "no episode has a clean force",
        ),
        card("not assessed", f"{lacking} of {len(of)}", "lack a figure that decides; the reasons are below"),
        card("unusual", f"{strange} of {len(of)}", "have a value far from the others, which need not be wrong"),
    )
