"""Each metric over all episodes: a dot an episode on a line, over a box of its quartiles. Drawn without a script."""

from collections.abc import Mapping
from html import escape

from wrenchflow.pages.page import section, table
from wrenchflow.process.data_set import DataSetQuality, Unusual
from wrenchflow.process.metric import METRICS, Metric, metric_of
from wrenchflow.process.report.shown import Shown
from wrenchflow.process.report.words import figure, gist, kind_of_reason, name_of

_TOP, _HEIGHT = 9.0, 26.0  # Of the band that dots lie in [px].
_ROWS = 10  # Of a table that are shown at once.
_GOLDEN = 0.6180339887498949  # Multiples of it are spread evenly, however many there are.
_MARKS = (
    '<svg class="marks" width="0" height="0" aria-hidden="true"><defs><circle id="dot" r="3.6"/>'
    '<path id="dot-defect" d="M-5 0 0-5 5 0 0 5Z"/></defs></svg>'
)
_TEXT = (
    "<p>Every episode is a dot; one with a defect is a diamond. The box holds the middle half of the episodes, the "
    "line in it is their median. Point at a dot to see whose it is, in every row; a click opens its page.</p>"
)


def distributions_section(quality: DataSetQuality, shown: Shown) -> str:
    """Distributions of the metrics that decide, and of the others in a fold."""
    known = [metric for metric in METRICS if metric.name in quality.distributions]
    first = "".join(
        _row(metric, quality, shown) if metric in known else _absent(metric, shown)
        for metric in METRICS
        if metric.decides
    )
    others = "".join(_row(metric, quality, shown) for metric in known if not metric.decides)
    if not known:
        return section("Distributions", "<p>not assessed: no figure of any episode could be told.</p>")
    fold = f"<details><summary>All other figures</summary><div class='strips'>{others}</div></details>"
    body = f'<div class="strips">{first}</div>'
    return section("Distributions", _TEXT, _MARKS, body, fold if others else "")


def _absent(metric: Metric, shown: Shown) -> str:
    reasons = {kind_of_reason(why): gist(why) for each in shown.assessments if (why := each.why_not(metric.name))}
    why = "; ".join(reasons.values()) or "no episode has it"
    said = f"<b>{escape(metric.title)}</b><small>not assessed in any episode: {escape(why)}</small>"
    return f'<div class="strip" title="{escape(metric.meaning)}"><div>{said}</div></div>'


def _row(metric: Metric, quality: DataSetQuality, shown: Shown) -> str:
    of = quality.distributions[metric.name]
    span = of.high - of.low

    def at(value: float) -> str:
        return f"{2.0 + 96.0 * ((value - of.low) / span if span > 0.0 else 0.5):.2f}%"

    dots = []
    for number, assessment in enumerate(shown.assessments):
        value = assessment[metric.name]
        if value is None:
            continue
        y = _TOP + _HEIGHT * ((number * _GOLDEN) % 1.0)
        kind = "dot" if assessment.is_sound else "dot-defect"
        label = f"{assessment.id}: {figure(metric, value)}"
        # The table has a link to every page for the keyboard; hundreds of dots would be in its way.
        tag = f'a href="{escape(shown.address(number))}" tabindex="-1"' if shown.pages else "g"
        dots.append(
            f'<{tag} data-e="{number}" aria-label="{escape(label)}">'
            f'<use href="#{kind}" class="{kind}" x="{at(float(value))}" y="{y:.1f}"/></{tag[0]}>'
        )
    missing = len(shown.assessments) - of.count
    wide = 96.0 * (of.three_quarters - of.quarter) / span if span > 0.0 else 0.0
    box = (
        f'<rect class="box" x="{at(of.quarter)}" width="{wide:.2f}%" y="4" height="36"/>'
        f'<line class="median" x1="{at(of.median)}" x2="{at(of.median)}" y1="2" y2="42"/>'
    )
    said = f"{figure(metric, of.low)} to {figure(metric, of.high)}, median {figure(metric, of.median)}"
    if span <= 0.0:
        said = f"{figure(metric, of.low)} in all"
    less = f"; not assessed in {missing}" if missing else ""
    name = f"<b>{escape(metric.title)}</b><small>{escape(said + less)}</small>"
    return (
        f'<div class="strip" title="{escape(metric.meaning)}"><div>{name}</div>'
        f'<svg role="img" aria-label="{escape(f"{metric.title}: {said}{less}")}">{box}{"".join(dots)}</svg></div>'
    )


def unusual_section(quality: DataSetQuality, shown: Shown) -> str:
    """Values that lie far from those of the other episodes of the task; they inform, and decide nothing."""
    text = (
        "<p>These lie far from the other episodes of the same task. It need not be wrong: a value decides nothing by "
        "being rare. A sigma is a robust standard deviation, from the median of what the episodes differ by.</p>"
    )
    if not quality.unusual:
        return section("Unusual values", "<p>No value lies far from those of the other episodes.</p>")
    head = ("episode", "figure", "value", "median", "sigmas")
    rows = [_unusual(each, shown) for each in quality.unusual]
    rest = rows[_ROWS:]
    more = f"<details><summary>{len(rest)} more</summary><div>{table(head, rest)}</div></details>" if rest else ""
    return section("Unusual values", text, table(head, rows[:_ROWS]), more)


def _unusual(each: Unusual, shown: Shown) -> tuple[str, ...]:
    title = "course of the force" if each.metric == "curve" else name_of(each.metric)
    values = (_value(each.metric, value) for value in (each.value, each.median))
    return (
        shown.name(shown.numbers[each.id]),
        f'<td class="text">◆ {escape(title)}</td>',
        *values,
        f"{each.sigmas:.1f}",
    )


def _value(name: str, value: float) -> str:
    if name == "curve":
        return f"{value:.2f}\u00a0N from the median"
    metric = metric_of(name)
    return escape(figure(metric, round(value) if metric.type is int and float(value).is_integer() else value))


def unusual_by_episode(quality: DataSetQuality) -> Mapping[tuple[str, str], Unusual]:
    """What is unusual, by episode and metric."""
    return {(each.id, each.metric): each for each in quality.unusual}
