"""What was found in the episodes, and what could not be looked at: grouped, so that what is alike is said once."""

from collections.abc import Mapping, Sequence
from html import escape

from wrenchflow.pages.page import section, table
from wrenchflow.process.data_set import DataSetQuality
from wrenchflow.process.finding import Finding, Severity
from wrenchflow.process.report.shown import Shown, place
from wrenchflow.process.report.words import advice, count, gist, kind_of_reason, name_of, sign, without_numbers

_ROWS = 10  # Of a group that are shown at once.
_EACH = 3  # Findings of one kind that are told of one episode here; its page has them all.


def findings_section(title: str, severities: Sequence[Severity], shown: Shown, *, nothing: str) -> str:
    """Findings of some severities, a group for each kind, the most frequent first.

    Args:
        title: Heading.
        severities: Which; groups of the first one are open.
        shown: The episodes.
        nothing: What to say if there is none, plain.
    """
    groups: dict[tuple[Severity, str], dict[int, list[Finding]]] = {}
    for number, assessment in enumerate(shown.assessments):
        for finding in assessment.findings:
            if finding.severity in severities:
                of_kind = groups.setdefault((finding.severity, finding.kind), {})
                of_kind.setdefault(number, []).append(finding)
    ranked = sorted(groups.items(), key=lambda each: (severities.index(each[0][0]), -len(each[1]), each[0][1]))
    body = "\n".join(_group(severity, kind, found, shown) for (severity, kind), found in ranked)
    return section(title, body or f'<p><span class="good">✓</span> {escape(nothing)}</p>')


def _group(severity: Severity, kind: str, found: Mapping[int, Sequence[Finding]], shown: Shown) -> str:
    rows = [row for number, findings in found.items() for row in _rows(number, findings, shown)]
    head = ("episode", "where", "columns", "evidence")
    rest = rows[_ROWS:]
    more = f"<details><summary>{len(rest)} more rows</summary><div>{table(head, rest)}</div></details>" if rest else ""
    summary = f"{sign(severity, name_of(kind))} <span class='soft'>in {count(len(found), 'episode')}</span>"
    is_open = " open" if severity == "defect" else ""
    return (
        f'<details class="group"{is_open}><summary>{summary}</summary>'
        f"<p><b>What to do:</b> {escape(advice(kind))}</p><div>{table(head, rows[:_ROWS])}{more}</div></details>"
    )


def _rows(number: int, findings: Sequence[Finding], shown: Shown) -> list[tuple[str, ...]]:
    assessment = shown.assessments[number]
    rows: list[tuple[str, ...]] = [
        (
            shown.name(number),
            escape(place(finding, assessment)),
            escape(", ".join(finding.columns)) or "all columns",
            f'<td class="text">{escape(finding.evidence)}</td>',
        )
        for finding in findings[:_EACH]
    ]
    if len(findings) > _EACH:
        more = f"and {len(findings) - _EACH} more of this kind in this episode"
        rows.append((shown.name(number), f'<td class="text soft" colspan="3">{more}</td>'))
    return rows


def not_assessed_section(quality: DataSetQuality, shown: Shown) -> str:
    """What could not be told, by its reason, and of which episodes."""
    # Reasons that differ in their numbers alone, or behind a colon, are one.
    groups: dict[str, dict[int, dict[str, list[str]]]] = {}
    for number, assessment in enumerate(shown.assessments):
        for each in assessment.not_assessed:
            of_reason = groups.setdefault(kind_of_reason(each.reason), {}).setdefault(number, {})
            of_reason.setdefault(each.reason, []).append(each.kind)
    ranked = sorted(groups.items(), key=lambda each: (-len(each[1]), each[0]))
    body = "\n".join(_reason(of, shown) for _, of in ranked)
    body += "\n".join(
        f"<p><b>not assessed:</b> {escape(name_of(each.kind))}: {escape(each.reason)}.</p>"
        for each in quality.not_assessed
    )
    text = "<p>No figure stands in for these: nobody can tell them from the recordings, and this is why.</p>"
    return section("Not assessed", text, body) if body else section("Not assessed", "<p>Everything was assessed.</p>")


def _reason(episodes: Mapping[int, Mapping[str, Sequence[str]]], shown: Shown) -> str:
    reasons = list(dict.fromkeys(reason for of in episodes.values() for reason in of))
    heading = reasons[0] if len({without_numbers(each) for each in reasons}) == 1 else gist(reasons[0])
    kinds = list(dict.fromkeys(name_of(kind) for of in episodes.values() for each in of.values() for kind in each))
    where = "all episodes" if len(episodes) == len(shown.assessments) else count(len(episodes), "episode")
    what = escape(", ".join(kinds)) if len(kinds) <= 3 else f"{count(len(kinds), 'figure')}: {escape(', '.join(kinds))}"
    # An episode's own reason is told where it is not the one in the heading.
    items = "".join(
        f"<li>{shown.name(number)}"
        + "".join(f" <span class='soft'>{escape(reason)}</span>" for reason in of if reason != heading)
        + "</li>"
        for number, of in episodes.items()
    )
    return (
        f'<details class="group"><summary>{escape(heading)} <span class="soft">{where}</span></summary>'
        f'<p><b>Cannot be told:</b> {what}.</p><ul class="names">{items}</ul></details>'
    )
