"""Force curves of all episodes of a task over each other, and where each of them began to touch."""

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from wrenchflow.pages import theme
from wrenchflow.pages.drawing import Drawing
from wrenchflow.pages.page import section
from wrenchflow.pages.plot_block import plot_block
from wrenchflow.process.data_set import DataSetQuality
from wrenchflow.process.report.shown import Shown
from wrenchflow.process.spread import AlignedCurves

_NAMED = 6  # Lines that can be told apart.
_DASHES = ("solid", "6px,3px", "2px,2px")
_OUTCOMES = (
    (True, "success", "circle", theme.AXIS_COLOURS[2]),
    (False, "failure", "x", theme.AXIS_COLOURS[0]),
    (None, "outcome not recorded", "diamond-open", theme.COLOURS[7]),
)
_TEXT = (
    "<p>The norm of the force from the first contact to the last, each curve stretched in time so that it fits the "
    "others (dynamic time warping). The band holds eight of ten episodes. What lies far from the median is named.</p>"
)


def curves_section(quality: DataSetQuality, shown: Shown) -> str:
    """Aligned force curves and coverage, a pair of plots a task."""
    tasks = list(dict.fromkeys(each.task for each in shown.assessments if each.curve or each.contact_start_m))
    parts = []
    for number, task in enumerate(tasks):
        plots = []
        if task in quality.curves:
            plots.append(_with_caption(curves_figure(quality, task, shown), f"curves-{number}", "Force in contact"))
        places = [k for k, each in enumerate(shown.assessments) if each.task == task and each.contact_start_m]
        if places:
            caption = "Where contact began, from the goal if it is known"
            plots.append(_with_caption(coverage_figure(places, shown), f"coverage-{number}", caption))
        parts.append(f'<h3>{escape(task) or "no task"}</h3><div class="pair">{"".join(plots)}</div>')
    if not parts:
        return section("Force curves and coverage", "<p>not assessed: no episode has a contact that is known.</p>")
    return section("Force curves and coverage", _TEXT, *parts)


def _with_caption(figure: Drawing, id: str, caption: str) -> str:
    return f"<figure><figcaption>{escape(caption)}</figcaption>{plot_block(figure, id)}</figure>"


def curves_figure(quality: DataSetQuality, task: str, shown: Shown) -> Drawing:
    """Median and band of a task's force curves, all others faint, unusual ones named."""
    curves = quality.curves[task]
    strange = [each.id for each in quality.unusual if each.metric == "curve" and each.id in curves.ids][:_NAMED]
    share = np.linspace(0.0, 100.0, len(curves.median_n)).astype(np.float32)
    figure = Drawing(layout=theme.plot_layout(300, hovermode="closest", showlegend=True))
    figure.data.extend(
        [
            _others(curves, strange, share),
            {**_line(share, curves.low_n, "", "rgba(0,0,0,0)", 0.0), "hoverinfo": "skip", "showlegend": False},
            {
                **_line(share, curves.high_n, "eight of ten", "rgba(0,0,0,0)", 0.0),
                "fill": "tonexty",
                "fillcolor": "rgba(59,143,217,0.22)",
                "hoverinfo": "skip",
            },
            _line(share, curves.median_n, "median", theme.ACCENT, 2.6),
        ]
    )
    for k, id in enumerate(strange):
        number = shown.numbers[id]
        line = _line(share, curves.force_n[curves.ids.index(id)], escape(id), theme.COLOURS[1 + k], 1.6)
        line["line"]["dash"] = _DASHES[k % len(_DASHES)]
        links = {"meta": "links", "customdata": [shown.address(number)] * len(share)} if shown.pages else {}
        figure.data.append(line | links)
    figure.layout["xaxis"] = {"title": {"text": "share of the time in contact [%]"}, "zeroline": False}
    figure.layout["yaxis"] = {"title": {"text": "force [N]"}, "rangemode": "tozero"}
    figure.layout["legend"] = {"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom"}
    return figure


def _line(x: np.ndarray, y: np.ndarray, name: str, colour: str, width: float) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": x,
        "y": y.astype(np.float32),
        "name": name,
        "line": {"color": colour, "width": width},
        "hovertemplate": f"{name}: %{{y:.3g}} N<extra></extra>",
    }


def _others(curves: AlignedCurves, strange: Sequence[str], share: np.ndarray) -> dict[str, Any]:
    """All curves that are not named, as one line with breaks: two hundred lines would take seconds to draw."""
    kept = [k for k, id in enumerate(curves.ids) if id not in strange]
    rows = np.hstack([curves.force_n[kept], np.full((len(kept), 1), np.nan)])
    line = _line(np.tile(np.append(share, np.nan), len(kept)).astype(np.float32), rows.ravel(), "episodes", "", 0.7)
    line["line"]["color"] = "rgba(122,130,140,0.35)"
    return line | {"hoverinfo": "skip", "hovertemplate": None}


def coverage_figure(places: Sequence[int], shown: Shown) -> Drawing:
    """Where the tcp was when contact began, from above.

    Args:
        places: Numbers of the episodes to draw; each has a known start of contact.
        shown: All episodes.
    """
    figure = Drawing(layout=theme.plot_layout(300, hovermode="closest", showlegend=True))
    for success, name, symbol, colour in _OUTCOMES:
        of = [k for k in places if shown.assessments[k].success is success]
        if not of:
            continue
        at_mm = 1e3 * np.array([shown.assessments[k].contact_start_m for k in of])
        trace = {
            "type": "scatter",
            "mode": "markers",
            "x": at_mm[:, 0].astype(np.float32),
            "y": at_mm[:, 1].astype(np.float32),
            "text": [escape(shown.assessments[k].id) for k in of],
            "name": name,
            "marker": {"symbol": symbol, "color": colour, "size": 8, "opacity": 0.75},
            "hovertemplate": "%{text}: x %{x:.2f}, y %{y:.2f} mm<extra></extra>",
        }
        links = {"meta": "links", "customdata": [shown.address(k) for k in of]} if shown.pages else {}
        figure.data.append(trace | links)
    figure.layout["xaxis"] = {"title": {"text": "x [mm]"}}
    figure.layout["yaxis"] = {"title": {"text": "y [mm]"}, "scaleanchor": "x"}
    figure.layout["legend"] = {"orientation": "h", "x": 0, "y": 1, "yanchor": "bottom"}
    return figure
