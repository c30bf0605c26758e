"""Rows over one axis of time: panels of lines that share a unit, and strips of lanes with bands."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.pages import theme
from wrenchflow.pages.decimation import keep_peaks
from wrenchflow.pages.drawing import Drawing

POINTS = 1000  # A line is rarely drawn over more pixels than this.
MAIN = {"width": 1.6}
THIN = {"width": 0.8}
DASHED = {"width": 1.2, "dash": "4px,3px"}

_HIGHEST = 1e30  # What is beyond is no measurement, and no number in single precision.
_GAP_PX = 36
_LETTER_PX = 7.5  # Of a lane's label, the widest letters that occur and a little air.


@dataclass(frozen=True, kw_only=True)
class Line:
    """A column over time; one that `is_beside` another, for comparison, is not named in the caption."""

    name: str
    t_ns: Int64[np.ndarray, " n"]
    values: Float[np.ndarray, " n"]
    colour: str
    style: Mapping[str, Any]
    is_beside: bool = False


@dataclass(frozen=True, kw_only=True)
class Panel:
    """One row of the figure: lines that share a unit, on a scale that shows zero where it `has_zero`."""

    quantity: str
    what: str
    unit: str
    lines: tuple[Line, ...]
    height_px: int = 190
    has_zero: bool = False


@dataclass(frozen=True, kw_only=True)
class Band:
    """Something that lasted."""

    start_ns: int
    stop_ns: int
    colour: str
    text: str = ""
    hover: str = ""


@dataclass(frozen=True, kw_only=True)
class Strip:
    """One row of the figure: lanes with bands, by their names, from the top down."""

    lanes: Mapping[str, Sequence[Band]]
    lane_px: int = 24

    @property
    def height_px(self) -> int:
        """Of all lanes together."""
        return self.lane_px * len(self.lanes)


def time_figure(
    rows: Sequence[Panel | Strip], title: str, *, zero_ns: int, view_ns: tuple[int, int], axis: str, points: int
) -> Drawing:
    """Draw rows above each other.

    Args:
        rows: From the top down; at least one.
        title: Plain text above them; may be empty.
        zero_ns: Where time counts from [ns].
        view_ns: What is in view at first [ns].
        axis: What the axis says.
        points: About how many points a line is drawn with.
    """
    heights_px = [row.height_px for row in rows]
    plot_px = sum(heights_px) + _GAP_PX * (len(rows) - 1)
    # An instant outcome stands above the bands, and the title above that.
    top_px, heading = (56, {"text": escape(title), "x": 0, "xref": "paper"}) if title else (24, None)
    layout = theme.plot_layout(plot_px, top_px=top_px, hovermode="x unified", barmode="overlay", bargap=0.12)
    layout |= {"title": heading} if heading else {}
    longest = max((len(name) for row in rows if isinstance(row, Strip) for name in row.lanes), default=0)
    layout["margin"]["l"] = max(layout["margin"]["l"], _LETTER_PX * longest)
    # A label that does not fit its band is left out; the mouse still tells it.
    layout["uniformtext"] = {"minsize": 10, "mode": "hide"}
    figure = Drawing(layout=layout)
    view_s = [(at_ns - zero_ns) * 1e-9 for at_ns in view_ns]
    below_px = float(plot_px)
    for number, row in enumerate(rows):
        below_px -= row.height_px
        at = "" if number == 0 else f"{number + 1}"
        is_last = number == len(rows) - 1
        layout[f"xaxis{at}"] = {
            "anchor": f"y{at}",
            "range": view_s,
            "zeroline": False,
            "spikethickness": 1,
            "unifiedhovertitle": {"text": "%{x:.3f} s"},
            **({"title": {"text": axis}} if is_last else {"showticklabels": False}),
            **({"matches": "x"} if number else {}),
        }
        layout[f"yaxis{at}"] = {
            "anchor": f"x{at}",
            "domain": [max(below_px / plot_px, 0.0), (below_px + row.height_px) / plot_px],
            "zeroline": False,
        }
        if isinstance(row, Strip):
            _draw_strip(figure, row, at, zero_ns)
        else:
            _draw_panel(figure, row, at, zero_ns, points)
        below_px -= _GAP_PX
    return figure


def shade(figure: Drawing, start_ns: int, stop_ns: int, zero_ns: int, colour: str) -> None:
    """Shade all rows from one time to another."""
    ends = {"x0": (start_ns - zero_ns) * 1e-9, "x1": (stop_ns - zero_ns) * 1e-9}
    figure.add_shape(
        type="rect", **ends, y0=0, y1=1, xref="x", yref="paper", fillcolor=colour, line={"width": 0}, layer="below"
    )


def mark(figure: Drawing, at_ns: int, zero_ns: int, text: str, colour: str) -> None:
    """A line through all rows, with a text above it."""
    at_s = (at_ns - zero_ns) * 1e-9
    figure.add_shape(type="line", x0=at_s, x1=at_s, y0=0, y1=1, xref="x", yref="paper", line={"color": colour})
    place = {"x": at_s, "xref": "x", "xanchor": "right", "y": 1, "yref": "paper", "yanchor": "bottom"}
    figure.add_annotation(text=escape(text), font={"color": colour}, showarrow=False, **place)


def _draw_panel(figure: Drawing, panel: Panel, at: str, zero_ns: int, points: int) -> None:
    for line in panel.lines:
        t_s, values = keep_peaks((line.t_ns - zero_ns) * 1e-9, line.values, points)
        values = np.where(np.abs(values) < _HIGHEST, values, np.nan)
        figure.data.append(
            {
                "type": "scatter",
                # Single precision draws the same line with half the bytes.
                "x": t_s.astype(np.float32),
                "y": values.astype(np.float32),
                "xaxis": f"x{at}",
                "yaxis": f"y{at}",
                "name": escape(line.name),
                "mode": "lines",
                "line": {**line.style, "color": line.colour},
                "opacity": 1.0 if line.style is MAIN else 0.75,
                "showlegend": False,
                "hovertemplate": f"%{{y:.3g}} {panel.unit}",
            }
        )
    mode = "tozero" if panel.has_zero else "normal"
    figure.layout[f"yaxis{at}"] |= {"nticks": max(3, panel.height_px // 32), "rangemode": mode}
    named = [line for line in panel.lines if not line.is_beside]
    names = " ".join(f'<span style="color:{line.colour}">{escape(line.name)}</span>' for line in named)
    text = f"{escape(panel.quantity)} <b>{names}</b> [{panel.unit}]"
    figure.add_annotation(
        text=text + (f" · {escape(panel.what)}" if panel.what else ""),
        showarrow=False,
        x=0,
        xref=f"x{at} domain",
        xanchor="left",
        y=1,
        yref=f"y{at} domain",
        yanchor="bottom",
    )


def _draw_strip(figure: Drawing, strip: Strip, at: str, zero_ns: int) -> None:
    for name, bands in strip.lanes.items():
        figure.data.append(
            {
                "type": "bar",
                "orientation": "h",
                "base": [(band.start_ns - zero_ns) * 1e-9 for band in bands],
                "x": [(band.stop_ns - band.start_ns) * 1e-9 for band in bands],
                "y": [name] * len(bands),
                "xaxis": f"x{at}",
                "yaxis": f"y{at}",
                "text": [escape(band.text) for band in bands],
                "customdata": [escape(band.hover or band.text) for band in bands],
                "textposition": "inside",
                "insidetextanchor": "middle",
                "textangle": 0,
                "marker": {"color": [band.colour for band in bands], "line": {"width": 0}},
                "showlegend": False,
                "hovertemplate": "%{customdata} from %{base:.2f} s for %{x:.3g} s<extra></extra>",
            }
        )
    order = {"categoryorder": "array", "categoryarray": [*strip.lanes][::-1]}
    figure.layout[f"yaxis{at}"] |= {**order, "type": "category", "fixedrange": True}
