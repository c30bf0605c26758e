"""Sections of the page on what was measured: forces and torques by axis, times, the workspace, actions."""

from collections.abc import Sequence
from html import escape

import numpy as np

from wrenchflow.datasets.analysis import trajectory as of
from wrenchflow.datasets.analysis.analysis import Analysis
from wrenchflow.datasets.analysis.distribution import Distribution
from wrenchflow.datasets.analysis.totals import Named
from wrenchflow.pages import theme
from wrenchflow.pages.drawing import Drawing
from wrenchflow.pages.page import NBSP, percent, section, table
from wrenchflow.pages.plot_block import plot_block

_TITLES = {
    of.WRENCH: "Wrench, measured",
    of.WRENCH_RAW: "Wrench as the sensor reads, with its bias and the tool's weight",
    of.ESTIMATED: "External wrench, ESTIMATED from joint torques: no sensor measured it",
    of.JOINT_TORQUE: "Torque of the joints, measured",
}
_HEAD = ("axis", "least", "1 %", "median", "99 %", "greatest", "mean", "deviation", "values", "not told")
_BINS = 60
_WHISKERS = (0.01, 0.25, 0.5, 0.75, 0.99)


def felt_section(analysis: Analysis) -> str:
    """Ranges of each axis of what was felt, and their distributions."""
    parts = []
    for name, title in _TITLES.items():
        for number, (named, found) in enumerate(_of(analysis, name)):
            parts.append(f"<h3>{escape(title)}</h3>{_caption(analysis, name)}{_axes(named, found)}")
            parts.append(plot_block(_boxes(named, found), f"felt-{name}-{number}"))
    if not parts:
        return section("What was felt", "<p>No force and no joint torque is in this data set.</p>")
    return section("What was felt", *parts)


def _caption(analysis: Analysis, name: str) -> str:
    if name != of.ESTIMATED:
        return ""
    std = analysis.values("estimated_force_std_n")
    if not len(std):
        return ""
    middle = float(np.median(std))
    return (
        f"<p>Of the median episode, the estimated force is uncertain by <b>{middle:.1f}{NBSP}N</b> (one standard "
        "deviation of its three axes together). A force that is not several times as large may be no force.</p>"
    )


def timing_section(analysis: Analysis) -> str:
    """How long steps, readings and pictures took, and what came late."""
    found = _of(analysis, of.TIMING)
    late, steps = analysis.values("late_steps"), analysis.values("steps")
    parts = []
    if len(late):
        pause = analysis.values("longest_pause_s")
        parts.append(
            f"<p>{int(late.sum()):,} of {int(steps.sum()):,} steps came late, by more than half a period; the longest "
            f"pause of all episodes is {pause.max():.2f}{NBSP}s.</p>"
        )
    skipped = analysis.values("skipped_actions")
    if len(skipped):
        parts.append(f"<p>{int(skipped.sum()):,} actions were recorded and skipped.</p>")
    for number, (named, each) in enumerate(found):
        parts.append(_axes(named, each))
        parts.append(plot_block(_boxes(named, each), f"timing-{number}"))
    if not parts:
        parts = ["<p>not assessed: this data set holds no time stamps of its own.</p>"]
    return section("Time stamps", *parts)


def actions_section(analysis: Analysis) -> str:
    """How much of the range of each action is used, and how evenly."""
    parts = []
    for number, (named, found) in enumerate(_of(analysis, of.ACTION)):
        parts.append(_axes(named, found))
        parts.append(plot_block(_boxes(named, found), f"action-{number}"))
        shares = [f"{escape(column)} {percent(_used(found, i))}" for i, column in enumerate(named[1])]
        parts.append(
            f"<p>Of {_BINS} equal parts of each axis from least to greatest, these were visited: {', '.join(shares)}."
            "</p>"
        )
    idle = analysis.values("idle_share")
    if len(idle):
        parts.append(f"<p>In {percent(float(idle.mean()))} of the steps nothing new was commanded.</p>")
    return section("Actions", *parts) if parts else ""


def _used(found: Distribution, column: int) -> float:
    low, high = found.low[column], found.high[column]
    if not high > low:
        return 0.0
    return float((found.counted(column, np.linspace(low, high, _BINS + 1)) > 0).mean())


def workspace_section(analysis: Analysis) -> str:
    """Where the tools have been, from above and from the side."""
    workspace = analysis.totals.workspace
    if not len(workspace):
        return section("Workspace", "<p>not assessed: no position of the tool is known.</p>")
    edge_m = analysis.config.voxel_m
    cells = workspace.cells
    low, high = cells.min(axis=0) * edge_m, (cells.max(axis=0) + 1) * edge_m
    spans = ", ".join(f"{name} {a:.2f} to {b:.2f}{NBSP}m" for name, a, b in zip("xyz", low, high, strict=True))
    text = (
        f"<p>{len(workspace):,} cells of {1e3 * edge_m:g}{NBSP}mm were visited, "
        f"{1e3 * len(workspace) * edge_m**3:,.1f} litres; {percent(workspace.seen_once)} of "
        f"them in one episode alone. {spans}.</p>"
    )
    plots = [
        f"<figure><figcaption>{title}</figcaption>{plot_block(_heat(analysis, axes), f'workspace-{axes[1]}')}</figure>"
        for title, axes in (("From above: steps in each column of cells", (0, 1)), ("From the side", (0, 2)))
    ]
    return section("Workspace", text, f'<div class="pair">{"".join(plots)}</div>')


def _heat(analysis: Analysis, axes: tuple[int, int]) -> Drawing:
    """Steps by two coordinates, on a logarithmic scale; where nobody was, nothing is drawn."""
    workspace, edge_m = analysis.totals.workspace, analysis.config.voxel_m
    cells = workspace.cells[:, list(axes)]
    low = cells.min(axis=0)
    size = cells.max(axis=0) - low + 1
    steps = np.zeros((size[1], size[0]))
    np.add.at(steps, (cells[:, 1] - low[1], cells[:, 0] - low[0]), workspace.visits)
    shown = np.where(steps > 0, np.log10(np.maximum(steps, 1)), np.nan)
    figure = Drawing(layout=theme.plot_layout(360, hovermode="closest"))
    x, y = ((low[k] + np.arange(size[k]) + 0.5) * edge_m for k in (0, 1))
    ticks = list(range(int(np.nanmax(shown)) + 1))
    figure.data.append(
        {
            "type": "heatmap",
            "x": np.round(x, 4).tolist(),
            "y": np.round(y, 4).tolist(),
            "z": np.round(shown, 2).tolist(),
            "customdata": steps.astype(int).tolist(),
            "colorscale": "Viridis",
            "colorbar": {"thickness": 10, "tickvals": ticks, "ticktext": [f"{10**k:,}" for k in ticks]},
            "hovertemplate": "%{x:.2f}, %{y:.2f} m: %{customdata} steps<extra></extra>",
        }
    )
    figure.layout["xaxis"] = {"title": {"text": f"{'xyz'[axes[0]]} [m]"}, "zeroline": False}
    figure.layout["yaxis"] = {"title": {"text": f"{'xyz'[axes[1]]} [m]"}, "scaleanchor": "x", "zeroline": False}
    return figure


def _of(analysis: Analysis, name: str) -> list[tuple[Named, Distribution]]:
    return [(named, found) for named, found in analysis.totals.tables() if named[0] == name]


def _axes(named: Named, found: Distribution) -> str:
    low, middle, high = (found.quantile(share) for share in (0.01, 0.5, 0.99))
    rows = []
    for i, (column, unit) in enumerate(zip(named[1], named[2], strict=True)):
        values = (found.low[i], low[i], middle[i], high[i], found.high[i], found.mean[i], found.std[i])
        name = escape(f"{column}{NBSP}[{unit}]" if unit else column)
        rows.append((name, *map(_said, values), f"{found.count[i]:,}", f"{found.missing[i]:,}"))
    return table(_HEAD, rows)


def _said(value: float) -> str:
    return f"{value:.3g}".replace("-", "\u2212") if np.isfinite(value) else "not told"


def _boxes(named: Named, found: Distribution) -> Drawing:
    """A box an axis: whiskers hold 98 % of the values. Axes of one unit share a plot's axis."""
    units = list(dict.fromkeys(named[2]))
    figure = Drawing(layout=theme.plot_layout(120 + 24 * len(named[1]), hovermode="closest"))
    quantiles = [found.quantile(share) for share in _WHISKERS]
    for k, unit in enumerate(units):
        at = [i for i, each in enumerate(named[2]) if each == unit and found.count[i]]
        suffix = "" if k == 0 else str(k + 1)
        low, first, median, third, high = ([float(q[i]) for i in at] for q in quantiles)
        figure.data.append(
            {
                "type": "box",
                "orientation": "h",
                "y": [named[1][i] for i in at],
                "lowerfence": low,
                "q1": first,
                "median": median,
                "q3": third,
                "upperfence": high,
                "xaxis": f"x{suffix}",
                "yaxis": f"y{suffix}",
                "marker": {"color": theme.COLOURS[k % len(theme.COLOURS)]},
                "showlegend": False,
            }
        )
        figure.layout[f"xaxis{suffix}"] = _axis(k, len(units), unit)
        figure.layout[f"yaxis{suffix}"] = {"autorange": "reversed", "anchor": f"x{suffix}", "automargin": True}
    return figure


def _axis(number: int, count: int, unit: str) -> dict[str, object]:
    width, gap = 1.0 / count, 0.06 if count > 1 else 0.0
    title: Sequence[str] = [unit] if unit else ["as stored"]
    return {
        "domain": [number * width + (gap if number else 0.0), (number + 1) * width],
        "anchor": f"y{'' if number == 0 else number + 1}",
        "title": {"text": f"{title[0]}; box: half of the values, whiskers: 98 %"},
    }
