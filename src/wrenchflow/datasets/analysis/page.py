"""The page that a person opens after `analyze`: what is wrong first, then what there is, by whom, and where."""

from html import escape

from wrenchflow.datasets.analysis import trajectory as of
from wrenchflow.datasets.analysis.analysis import Analysis
from wrenchflow.datasets.analysis.compared import collectors_section, groups_section, relevance_section, twins_section
from wrenchflow.datasets.analysis.measured import (
    actions_section,
    felt_section,
    timing_section,
    workspace_section,
)
from wrenchflow.datasets.analysis.wrong import findings_section, left_out_section, missing_section
from wrenchflow.pages.page import NBSP, card, cards, page, percent, section


def analysis_page(analysis: Analysis) -> str:
    """The page, self-contained.

    Args:
        analysis: What is known.
    """
    pieces = {
        "Wrong": findings_section(analysis),
        "Left out": left_out_section(analysis) + missing_section(analysis),
        "Felt": felt_section(analysis),
        "Compared": groups_section(analysis),
        "Collectors": collectors_section(analysis),
        "Timing": timing_section(analysis),
        "Workspace": workspace_section(analysis),
        "Actions": actions_section(analysis),
        "Duplicates": twins_section(analysis),
        "Relevance": relevance_section(analysis),
        "Assumed": _assumed(analysis),
    }
    there = {name: piece for name, piece in pieces.items() if piece}
    links = " ".join(f'<a href="#s{i}">{escape(name)}</a>' for i, name in enumerate(there))
    return page(
        f"Analysis of {len(analysis.totals.episodes)} episodes",
        [
            _headline(analysis),
            _cards(analysis),
            f'<nav class="contents" aria-label="Contents">{links}</nav>',
            *(f'<div id="s{i}">{piece}</div>' for i, piece in enumerate(there.values())),
        ],
        "wrenchflow analyze. The tables beside this page hold all of it: a row an episode, a group, an axis.",
    )


def _headline(analysis: Analysis) -> str:
    bad, total = len(analysis.defective), len(analysis.totals.episodes)
    said = (
        f"<b>{bad:,} of {total:,} episodes</b> have a defect that is named below."
        if bad
        else f"Nothing was found that decides against any of the {total:,} episodes."
    )
    felt = {named[0] for named, _ in analysis.totals.tables()}
    if of.ESTIMATED in felt:
        said += (
            " This data set has <b>no force sensor</b>: forces below are estimated from the torques of the joints, "
            "and named so."
        )
    elif not felt & {of.WRENCH, of.WRENCH_RAW}:
        said += " This data set holds no force."
    return f"<h1>Analysis of a data set</h1><p>{escape(analysis.kind)}. {said}</p>"


def _cards(analysis: Analysis) -> str:
    episodes = analysis.totals.episodes
    seconds, steps = analysis.values("duration_s"), analysis.values("steps")
    known = [each.labels.success for each in episodes if each.labels.success is not None]
    count = {
        kind: sum(group.kind == kind for group in analysis.groups) for kind in ("task", "lab", "collector", "scene")
    }
    shown = [
        card("episodes", f"{len(episodes):,}", f"{len(analysis.totals.left_out):,} more were left out"),
        card("with defects", f"{len(analysis.defective):,}", "listed first, with what they do"),
        card(
            "data", _duration(float(seconds.sum())) if len(seconds) else "not assessed", f"{int(steps.sum()):,} steps"
        ),
        card(
            "outcome",
            percent(sum(known) / len(known)) if known else "not assessed",
            f"of {len(known):,} that say so succeeded" if known else "no episode says what came of it",
        ),
        card(
            "tasks",
            f"{count['task']:,}",
            f"{count['lab']} labs, {count['collector']} collectors, {count['scene']} scenes",
        ),
        _contact_card(analysis),
        _force_card(analysis),
        card("near duplicates", f"{len(analysis.twins):,}", "pairs of episodes with the same motion"),
    ]
    return cards(*shown)


def _duration(seconds: float) -> str:
    return f"{seconds / 3600.0:,.1f}{NBSP}h" if seconds >= 7200.0 else f"{seconds / 60.0:,.1f}{NBSP}min"


def _contact_card(analysis: Analysis) -> str:
    for figure, by in (("contact_rate", "by measured force"), ("estimated_contact_rate", "by estimated force")):
        rates = analysis.values(figure)
        if len(rates):
            return card("time in contact", percent(float(rates.mean())), by)
    return card("time in contact", "not assessed", "no force that tells it")


def _force_card(analysis: Analysis) -> str:
    for figure, by in (("peak_force_n", "measured"), ("estimated_peak_force_n", "estimated")):
        peaks = analysis.values(figure)
        if len(peaks):
            middle, high = sorted(peaks)[len(peaks) // 2], sorted(peaks)[int(0.95 * (len(peaks) - 1))]
            return card(
                f"peak force, {by}", f"{middle:.1f}{NBSP}N", f"median episode; 95 % stay below {high:.1f}{NBSP}N"
            )
    return card("peak force", "not assessed", "no force")


def _assumed(analysis: Analysis) -> str:
    """What the figures rest on that nobody measured."""
    config = analysis.config
    texts = []
    if any(named[0] == of.ESTIMATED for named, _ in analysis.totals.tables()):
        torques = ", ".join(f"{value:g}" for value in config.torque_std_nm)
        texts.append(
            "<p>The <b>estimated external wrench</b> is what the robot exerts on its environment, in base axes, about "
            "the flange. It is made of the measured torques of the joints, less what holds the arm (masses by Gaz and "
            f"others, 2019) and a hand of {config.hand_mass_kg:g}{NBSP}kg, less the mean of the first "
            f"{config.tare_s:g}{NBSP}s, in which nothing is taken to be touched. Friction and acceleration are not "
            f"modelled. A torque is taken to be uncertain by {torques}{NBSP}N.m (joint 1 to 7, one standard "
            "deviation); where the seven torques contradict each other by more, the uncertainty is raised until they "
            "agree. A row counts as contact where the force differs from zero at the level of one in a thousand.</p>"
        )
    texts.append(
        "<p>Contact of a measured force that comes without contacts of its own begins at six deviations of its noise, "
        f"and at 1{NBSP}N at least, above the median of the first {config.tare_s:g}{NBSP}s, and ends at half of that. "
        "Quantiles are right within 1&nbsp;%. A lack of findings says that these checks found nothing, and no more.</p>"
    )
    return section("What is assumed", *texts)
