"""Sections of the page that compare episodes: by group, by collector, to find copies, and by relevance to a task."""

from html import escape

import numpy as np

from wrenchflow.datasets.analysis.analysis import Analysis, Group
from wrenchflow.datasets.analysis.figures import FIGURES
from wrenchflow.datasets.analysis.tables import success_rate
from wrenchflow.pages.page import NBSP, percent, section, table

_SHOWN = 12
# A column of groups: its head, the figure, and how many digits its median has.
_COLUMNS = (
    ("duration s", "duration_s", 1),
    ("path m", "path_m", 2),
    ("in contact", "contact_rate", -1),
    ("in contact, estimated", "estimated_contact_rate", -1),
    ("peak force N", "peak_force_n", 1),
    ("peak force N, estimated", "estimated_peak_force_n", 1),
    ("peak torque N.m", "peak_joint_torque_nm", 1),
    ("step ms", "step_ms", 0),
)
_UNITS = {figure.name: figure.unit for figure in FIGURES}


def groups_section(analysis: Analysis) -> str:
    """A table for each kind of group."""
    kinds = list(dict.fromkeys(group.kind for group in analysis.groups))
    if not kinds:
        return section("Compared", "<p>No episode says its task, lab, collector, scene or outcome.</p>")
    columns = [column for column in _COLUMNS if len(analysis.values(column[1]))]
    head = ("", "episodes", "succeeded", "with defects", *(head for head, _, _ in columns))
    parts = ["<p>Medians over the episodes of each; ranges of every axis are in axes.parquet.</p>"]
    for kind in kinds:
        groups = [group for group in analysis.groups if group.kind == kind]
        rows = [_row(analysis, group, columns) for group in groups]
        rest = rows[_SHOWN:]
        more = (
            f"<details><summary>{len(rest):,} more</summary><div>{table(head, rest[:500])}</div></details>"
            if rest
            else ""
        )
        shown = f'<div class="compared">{table(head, rows[:_SHOWN], wide=True)}</div>'
        parts.append(f"<h3>By {escape(kind)}</h3>{shown}{more}")
    return section("Compared", *parts)


def _row(analysis: Analysis, group: Group, columns: list[tuple[str, str, int]]) -> tuple[str, ...]:
    rate = success_rate(analysis, group.episodes)
    bad = len(analysis.defective.intersection(group.episodes))
    cells = []
    for _, figure, digits in columns:
        values = analysis.values(figure, group.episodes)
        middle = float(np.median(values)) if len(values) else float("nan")
        cells.append("not told" if not len(values) else percent(middle) if digits < 0 else f"{middle:,.{digits}f}")
    told = "not told" if rate is None else percent(rate)
    return (f"<span>{escape(group.name)}</span>", f"{len(group.episodes):,}", told, f"{bad:,}", *cells)


def collectors_section(analysis: Analysis) -> str:
    """How far those who collect differ on one task."""
    if not analysis.spreads:
        text = "<p>not assessed: no task was demonstrated three times by each of two people or more.</p>"
        return section("Spread between collectors", text)
    text = (
        "<p>For one task, the standard deviation between collectors against that of one collector's own episodes. "
        "Above 1, who demonstrates matters more than chance: a policy may learn the person. A single figure of few "
        "collectors proves little.</p>"
    )
    head = ("task", "figure", "collectors", "episodes", "between", "within", "ratio", "least and greatest mean")
    rows = []
    for each in analysis.spreads:
        unit = _UNITS[each.figure]
        (least, low), *_, (most, high) = sorted(each.means.items(), key=lambda one: one[1])
        rows.append(
            (
                f"<span>{escape(each.task)}</span>",
                f'<td class="text">{escape(each.figure)}</td>',
                f"{each.collectors}",
                f"{each.episodes:,}",
                escape(f"{each.between:.3g}{NBSP}{unit}".strip()),
                escape(f"{each.within:.3g}{NBSP}{unit}".strip()),
                "no limit" if np.isinf(each.ratio) else f"{each.ratio:.2f}",
                f'<td class="text">{escape(f"{low:.3g} of {least} to {high:.3g} of {most}")}</td>',
            )
        )
    rest = rows[_SHOWN:]
    more = (
        f"<details><summary>{len(rest):,} more</summary><div>{table(head, rest[:500])}</div></details>" if rest else ""
    )
    return section("Spread between collectors", text, table(head, rows[:_SHOWN]), more)


def twins_section(analysis: Analysis) -> str:
    """Pairs of episodes that are nearly the same."""
    if not analysis.twins:
        return section("Near duplicates", "<p>No two episodes went through the same postures.</p>")
    text = "<p>Keep one of each pair, or both on one side of a split: a copy in the validation set proves nothing.</p>"
    episodes = analysis.totals.episodes
    rows = [
        (
            f"<span>{escape(episodes[one.first].id)}</span>",
            f'<td class="text">{escape(episodes[one.second].id)}</td>',
            f"{one.apart:.2g} {'rad' if one.of == 'joints' else 'm'}",
        )
        for one in analysis.twins[:_SHOWN]
    ]
    more = len(analysis.twins) - len(rows)
    rest = f"<p>And {more:,} more, in duplicates.parquet.</p>" if more > 0 else ""
    return section("Near duplicates", text, table(("episode", "nearly the same", "apart"), rows), rest)


def relevance_section(analysis: Analysis) -> str:
    """Which episodes are suggested for the task that was asked about."""
    if not analysis.config.task:
        return ""
    taken = sum(one.is_taken for one in analysis.relevance)
    text = (
        f"<p>For <b>{escape(analysis.config.task)}</b>, {taken:,} of {len(analysis.relevance):,} episodes are "
        "suggested (relevant.txt): those that share the most telling words of the task, succeeded, have no defect "
        "and are no copies. Words are all that is compared: look at some before you train.</p>"
    )
    head = ("episode", "task", "score", "", "why")
    rows = [
        (
            f"<span>{escape(analysis.totals.episodes[one.episode].id)}</span>",
            f'<td class="text">{escape(analysis.totals.episodes[one.episode].labels.task)}</td>',
            f"{one.score:.2f}",
            '<span class="good">take</span>' if one.is_taken else "leave",
            f'<td class="text">{escape(one.why)}</td>',
        )
        for one in analysis.relevance
    ]
    rest = rows[_SHOWN:]
    more = (
        f"<details><summary>{len(rest):,} more</summary><div>{table(head, rest[:500])}</div></details>" if rest else ""
    )
    return section("Relevance", text, f'<div class="group">{table(head, rows[:_SHOWN])}</div>', more)
