"""Sections of the page on what is wrong: findings, episodes that were left out, columns that are not there."""

from collections import Counter
from html import escape

from wrenchflow.datasets.analysis.analysis import Analysis
from wrenchflow.datasets.analysis.figures import FIGURES
from wrenchflow.datasets.analysis.findings import Finding
from wrenchflow.pages.page import section, table

_NAMED = 12
_FIGURES = {figure.name: figure for figure in FIGURES}


def findings_section(analysis: Analysis) -> str:
    """Each kind that was found, with what it does and the episodes that have most of it."""
    if not analysis.findings:
        return section("What is wrong", "<p>Nothing was found.</p>")
    folds = [_fold(analysis, finding) for finding in analysis.findings]
    return section("What is wrong", *folds)


def _fold(analysis: Analysis, finding: Finding) -> str:
    severity = "defect" if finding.kind.is_defect else "note"
    figure = _FIGURES[finding.kind.figure]
    rows = []
    for i in finding.episodes[:_NAMED]:
        episode = analysis.totals.episodes[i]
        value = episode.values[figure.name]
        assert value is not None  # It was found by its value.
        shown = f"{value:,}" if figure.whole else f"{value:,.3g}"
        rows.append((_name(episode.id), _text(episode.place), escape(f"{shown} {figure.unit}".strip())))
    more = len(finding.episodes) - len(rows)
    rest = f"<p>And {more:,} more, in findings.parquet.</p>" if more > 0 else ""
    count = len(finding.episodes)
    return (
        f'<details{" open" if finding.kind.is_defect else ""} class="group"><summary><span class="{severity}">'
        f"{severity}</span> {escape(finding.kind.name)} in {count:,} episode{'' if count == 1 else 's'}"
        f'<span class="soft">{escape(finding.kind.meaning)}</span></summary><div>'
        f"{table(('episode', 'where', figure.name), rows)}{rest}</div></details>"
    )


def left_out_section(analysis: Analysis) -> str:
    """Episodes that could not be looked at, by reason."""
    left_out = analysis.totals.left_out
    if not left_out:
        return ""
    rows = [(_name(place), _text(reason)) for place, reason in left_out[:_NAMED]]
    more = len(left_out) - len(rows)
    rest = f"<p>And {more:,} more, in left_out.parquet.</p>" if more > 0 else ""
    return section(f"Left out: {len(left_out):,}", f'<div class="group">{table(("where", "why"), rows)}</div>', rest)


def missing_section(analysis: Analysis) -> str:
    """Columns that episodes should have and have not: what rests on them is not assessed."""
    episodes = analysis.totals.episodes
    counts = Counter(name for episode in episodes for name in episode.missing)
    if not counts:
        return ""
    rows = [
        (_text(name), f"{count:,} of {len(episodes):,}", _name(_first(analysis, name)))
        for name, count in counts.most_common()
    ]
    text = "<p>Figures that rest on these are not assessed, and not taken for zero.</p>"
    return section("Not there", text, f'<div class="group">{table(("what", "episodes", "the first"), rows)}</div>')


def _first(analysis: Analysis, name: str) -> str:
    return next(episode.id for episode in analysis.totals.episodes if name in episode.missing)


def _name(id: str) -> str:
    return f"<span>{escape(id)}</span>"


def _text(text: str) -> str:
    return f'<td class="text">{escape(text)}</td>'
