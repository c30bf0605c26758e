"""One episode over time: force, moment and position under a band of its phases, contacts and outcome."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from jaxtyping import Float, Int64
from plotly.graph_objects import Bar, Figure, Scatter
from plotly.subplots import make_subplots

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import StreamError
from wrenchflow.pages import theme
from wrenchflow.pages.decimation import keep_peaks

POINTS = 1000  # A line is rarely drawn over more pixels than this.

_LANES = ("phase", "contact", "anomaly", "intervention")
_LANE_PX, _PANEL_PX, _GAP_PX = 24, 190, 36
_MAIN = {"width": 1.6}
_THIN = {"width": 0.8}
_DASHED = {"width": 1.2, "dash": "4px,3px"}


@dataclass(frozen=True, kw_only=True)
class _Line:
    """One column over time, of axis 0 to 2 (x, y, z)."""

    name: str
    t_ns: Int64[np.ndarray, " n"]
    values: Float[np.ndarray, " n"]
    axis: int
    style: dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class _Panel:
    """One row of the figure: lines that share a unit."""

    quantity: str
    what: str
    unit: str
    lines: tuple[_Line, ...]


def episode_figure(episode: Episode, title: str, *, points: int = POINTS) -> Figure:
    """Draw an episode: bands of its events, force [N], moment [N.m], and TCP position against the goal [mm].

    Force is `wrench` (causal) with `wrench_zero_phase` as a thin line, or else `wrench_raw` less its mean during the
    tare. Time counts from the end of the tare. Lines longer than `points` are thinned to the smallest and largest
    sample of each stretch, so that peaks stay. What an episode does not have is left out.

    Args:
        episode: With `wrench`, `wrench_raw` or `tcp_pose` at least.
        title: Plain text above the plot; may be empty.
        points: About how many points a line is drawn with.

    Raises:
        StreamError: If there is nothing to draw.
    """
    panels = [*_wrench_panels(episode), *_position_panels(episode)]
    if not panels:
        raise StreamError(
            f"episode {episode.id} has nothing to plot: expected samples in wrench, wrench_raw or tcp_pose. "
            f"It has: {', '.join(sorted(episode.streams)) or 'none'}."
        )
    tare = _tare(episode)
    zero_ns = tare.stop_ns if tare else episode.span_ns[0]
    lanes = [kind for kind in _LANES if episode.events_of(kind)]
    rows_px = [_LANE_PX * len(lanes)] * bool(lanes) + [_PANEL_PX] * len(panels)
    plot_px = sum(rows_px) + _GAP_PX * (len(rows_px) - 1)
    figure = make_subplots(len(rows_px), 1, shared_xaxes=True, row_heights=rows_px, vertical_spacing=_GAP_PX / plot_px)
    _draw_lanes(figure, episode, lanes, zero_ns)
    for row, panel in enumerate(panels, start=1 + bool(lanes)):
        for line in panel.lines:
            figure.add_trace(_scatter(line, panel.unit, zero_ns, points), row=row, col=1)
        _caption(figure, panel, row)
    _shade(figure, episode, zero_ns)
    # The rest before the tare is out of view until a second double click.
    first_ns, last_ns = tare.start_ns if tare else episode.span_ns[0], episode.span_ns[1]
    margin_ns = 0.01 * (last_ns - first_ns)
    view_s = [(first_ns - zero_ns) * 1e-9, (last_ns + margin_ns - zero_ns) * 1e-9]
    figure.update_xaxes(range=view_s, zeroline=False, spikethickness=1, unifiedhovertitle_text="%{x:.3f} s")
    figure.update_xaxes(
        title_text=f"time from the {'end of the tare' if tare else 'start of the recording'} [s]", row=len(rows_px)
    )
    figure.update_yaxes(zeroline=False, nticks=6)
    # An instant outcome stands above the bands, and the title above that.
    top_px, heading = (56, {"text": escape(title), "x": 0, "xref": "paper"}) if title else (24, None)
    figure.update_layout(
        theme.plot_layout(plot_px, top_px=top_px, title=heading, hovermode="x unified", barmode="overlay", bargap=0.12)
    )
    return figure


def _tare(episode: Episode) -> Event | None:
    return next((event for event in episode.events_of("phase") if event.label == "tare"), None)


def _wrench_panels(episode: Episode) -> list[_Panel]:
    if "wrench" in episode and len(episode["wrench"]):
        causal = episode["wrench"]
        drawn = [(causal, "", _MAIN)]
        if "wrench_zero_phase" in episode:
            drawn.append((episode["wrench_zero_phase"], " zero-phase", _THIN))
        what = f"wrench, {causal.frame} axes" + ("; thin: zero-phase" if len(drawn) > 1 else "")
    elif "wrench_raw" in episode and len(episode["wrench_raw"]):
        raw, tare = episode["wrench_raw"], _tare(episode)
        rest = raw.between(tare.start_ns, tare.stop_ns).data if tare else raw.data[:0]
        bias = rest.mean(axis=0) if len(rest) else np.zeros(raw.signal.width)
        drawn = [(Stream(raw.t, raw.data - bias, raw.signal, raw.frame), "", _THIN)]
        what = f"wrench_raw {'less its mean during the tare' if len(rest) else 'as read'}, {raw.frame} axes"
    else:
        return []
    return [
        _Panel(quantity=quantity, what=what, unit=unit, lines=tuple(_lines(drawn, first)))
        for quantity, unit, first in (("force", "N", 0), ("moment", "N.m", 3))
        if first + 3 <= drawn[0][0].signal.width
    ]


def _lines(drawn: Sequence[tuple[Stream, str, dict[str, Any]]], first: int) -> list[_Line]:
    return [
        _Line(name=name + suffix, t_ns=stream.t, values=stream.data[:, first + axis], axis=axis, style=style)
        for stream, suffix, style in drawn
        for axis, name in enumerate(stream.signal.columns[first : first + 3])
    ]


def _position_panels(episode: Episode) -> list[_Panel]:
    if "tcp_pose" not in episode or not len(episode["tcp_pose"]):
        return []
    tcp, goal = episode["tcp_pose"], episode.streams.get("goal_pose")
    if goal is None or not len(goal) or goal.frame != tcp.frame:
        goal, origin = Stream(tcp.t[:1], tcp.data[:1], tcp.signal, tcp.frame), "where the recording starts"
    else:
        origin = "the perceived goal"
    drawn = [(_offset_mm(tcp, goal), "", _MAIN)]
    target = episode.streams.get("target_pose")
    what = f"from {origin}, {tcp.frame} axes"
    if target is not None and target.frame == tcp.frame:
        drawn.append((_offset_mm(target, goal), " target", _DASHED))
        what += "; dashed: target"
    return [_Panel(quantity="TCP position", what=what, unit="mm", lines=tuple(_lines(drawn, 0)))]


def _offset_mm(pose: Stream, origin: Stream) -> Stream:
    """Poses with their position from the last `origin` known then, or the first one there is [mm]."""
    known = np.maximum(np.searchsorted(origin.t, pose.t, side="right") - 1, 0)
    data = pose.data.copy()
    data[:, :3] = 1e3 * (data[:, :3] - origin.data[known, :3])
    return Stream(pose.t, data, pose.signal, pose.frame)


def _scatter(line: _Line, unit: str, zero_ns: int, points: int) -> Scatter:
    t_s, values = keep_peaks((line.t_ns - zero_ns) * 1e-9, line.values, points)
    return Scatter(
        # Single precision draws the same line with half the bytes.
        x=t_s.astype(np.float32),
        y=values.astype(np.float32),
        name=line.name,
        mode="lines",
        line={**line.style, "color": theme.AXIS_COLOURS[line.axis]},
        opacity=1.0 if line.style is _MAIN else 0.75,
        showlegend=False,
        hovertemplate=f"%{{y:.3g}} {unit}",
    )


def _caption(figure: Figure, panel: _Panel, row: int) -> None:
    names = " ".join(
        f'<span style="color:{theme.AXIS_COLOURS[line.axis]}">{escape(line.name)}</span>' for line in panel.lines[:3]
    )
    figure.add_annotation(
        text=f"{escape(panel.quantity)} <b>{names}</b> [{panel.unit}] · {escape(panel.what)}",
        showarrow=False,
        x=0,
        xref="x domain",
        xanchor="left",
        y=1,
        yref="y domain",
        yanchor="bottom",
        row=row,
        col=1,
    )


def _draw_lanes(figure: Figure, episode: Episode, lanes: Sequence[str], zero_ns: int) -> None:
    colours = {"contact": theme.CONTACT, "anomaly": theme.BAD, "intervention": theme.ACCENT}
    for kind in lanes:
        events = episode.events_of(kind)
        figure.add_trace(
            Bar(
                orientation="h",
                base=[(event.start_ns - zero_ns) * 1e-9 for event in events],
                x=[(event.stop_ns - event.start_ns) * 1e-9 for event in events],
                y=[kind] * len(events),
                text=[escape(event.label) for event in events],
                textposition="inside",
                insidetextanchor="middle",
                textangle=0,
                marker={"color": [theme.PHASE[k % 2] for k in range(len(events))] if kind == "phase" else colours[kind]}
                | {"line": {"width": 0}},
                showlegend=False,
                hovertemplate="%{text} from %{base:.2f} s for %{x:.2f} s<extra></extra>",
            ),
            row=1,
            col=1,
        )
    if lanes:
        figure.update_yaxes(categoryorder="array", categoryarray=lanes[::-1], fixedrange=True, row=1, col=1)
        # A label that does not fit its band is left out; the mouse still tells it.
        figure.update_layout(uniformtext={"minsize": 10, "mode": "hide"})


def _shade(figure: Figure, episode: Episode, zero_ns: int) -> None:
    shades = {"contact": theme.CONTACT_SHADE, "anomaly": theme.ANOMALY_SHADE}
    for kind, colour in shades.items():
        for event in episode.events_of(kind):
            _band(figure, event, zero_ns, colour)
    for event in episode.events_of("phase")[1::2]:
        _band(figure, event, zero_ns, theme.PHASE_SHADE)
    for kind, colour in (("success", theme.GOOD), ("failure", theme.BAD)):
        for event in episode.events_of(kind):
            at_s = (event.stop_ns - zero_ns) * 1e-9
            figure.add_shape(type="line", x0=at_s, x1=at_s, y0=0, y1=1, xref="x", yref="paper", line={"color": colour})
            figure.add_annotation(
                text=escape(f"{kind}: {event.label}" if event.label else kind),
                font={"color": colour},
                showarrow=False,
                x=at_s,
                xref="x",
                xanchor="right",
                y=1,
                yref="paper",
                yanchor="bottom",
            )


def _band(figure: Figure, event: Event, zero_ns: int, colour: str) -> None:
    ends = {"x0": (event.start_ns - zero_ns) * 1e-9, "x1": (event.stop_ns - zero_ns) * 1e-9}
    figure.add_shape(
        type="rect", **ends, y0=0, y1=1, xref="x", yref="paper", fillcolor=colour, line={"width": 0}, layer="below"
    )
