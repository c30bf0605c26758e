"""The table of all episodes: sorted by a click on a column, searched by a word."""

from collections.abc import Mapping
from html import escape

from wrenchflow.pages.page import section
from wrenchflow.process.assessment import Assessment
from wrenchflow.process.data_set import DataSetQuality, Unusual
from wrenchflow.process.metric import METRICS, Metric
from wrenchflow.process.report.shown import Shown
from wrenchflow.process.report.strips import unusual_by_episode
from wrenchflow.process.report.words import NOT_ASSESSED, figure, name_of, outcome, verdict

_SHOWN = (*(metric for metric in METRICS if metric.name == "duration_s"), *(each for each in METRICS if each.decides))
_SEARCH = (
    '<p class="tools"><label>Search <input type="search" id="search" placeholder="episode, task, finding"></label> '
    '<label><input type="checkbox" id="only-defects"> with defects only</label> <output id="found"></output></p>'
)
_TEXT = (
    "<p>A click on a column's name sorts by it. ◆ marks an unusual value; why a figure is not assessed stands above, "
    "and on the episode's page.</p>"
)


def episodes_section(quality: DataSetQuality, shown: Shown) -> str:
    """The table, with what sorts and searches it; without a script it is still a table."""
    strange = unusual_by_episode(quality)
    names = ("episode", "verdict", "findings", "task", "outcome")
    head = "".join(f'<th scope="col">{name}</th>' for name in names) + "".join(
        f'<th scope="col" title="{escape(metric.meaning)}">{escape(metric.title)}'
        f"<small>{escape(metric.unit)}</small></th>"
        for metric in _SHOWN
    )
    rows = "\n".join(_row(number, each, shown, strange) for number, each in enumerate(shown.assessments))
    body = (
        f'<div class="scroll"><table class="episodes" id="episodes"><thead><tr>{head}</tr></thead>\n'
        f"<tbody>{rows}</tbody></table></div>"
    )
    return section("All episodes", _TEXT, _SEARCH, body)


def _row(number: int, assessment: Assessment, shown: Shown, strange: Mapping[tuple[str, str], Unusual]) -> str:
    weight = 1000 * assessment.count("defect") + assessment.count("warning")
    kinds = ", ".join(dict.fromkeys(name_of(each.kind) for each in assessment.findings if each.severity != "note"))
    cells = "".join(_cell(metric, assessment, strange.get((assessment.id, metric.name))) for metric in _SHOWN)
    bad = "" if assessment.is_sound else ' class="with-defect"'
    return (
        f"<tr{bad}><td>{shown.name(number)}</td><td class='text' data-v='{weight}'>{verdict(assessment)}</td>"
        f"<td class='text'>{escape(kinds) or 'none'}</td><td class='text'>{escape(assessment.task) or 'not recorded'}"
        f"</td><td class='text'>{outcome(assessment.success)}</td>{cells}</tr>"
    )


def _cell(metric: Metric, assessment: Assessment, strange: Unusual | None) -> str:
    value = assessment[metric.name]
    if value is None:
        return f'<td class="soft" data-v="" title="{escape(assessment.why_not(metric.name))}">{NOT_ASSESSED}</td>'
    mark = f'<span title="{strange.sigmas:.1f} sigmas from the median">◆</span>\u00a0' if strange else ""
    return f'<td data-v="{float(value):.9g}">{mark}{escape(figure(metric, value, unit=False))}</td>'
