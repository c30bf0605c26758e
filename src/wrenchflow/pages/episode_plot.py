"""One episode over time: force, moment and position under a band of its phases, contacts and outcome."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import StreamError
from wrenchflow.ledger import Ledger
from wrenchflow.pages import theme
from wrenchflow.pages.drawing import Drawing
from wrenchflow.pages.ledger_plot import ledger_rows, shade_modes
from wrenchflow.pages.time_plot import DASHED, MAIN, POINTS, THIN, Band, Line, Panel, Strip, mark, shade, time_figure

_LANES = ("phase", "contact", "contact_mode", "anomaly", "intervention")


def episode_figure(
    episode: Episode, title: str, *, points: int = POINTS, more: Sequence[Panel] | None = None
) -> Drawing:
    """Draw an episode: bands of its events, force [N], moment [N.m], TCP position against the goal [mm], and energy.

    Force is `wrench` (causal) with `wrench_zero_phase` as a thin line, or else `wrench_raw` less its mean during the
    tare. What the safety layer did is below, see `ledger_plot`. Time counts from the end of the tare. Lines longer than
    `points` are thinned to the smallest and largest sample of each stretch, so that peaks stay. What an episode does
    not have is left out.

    Args:
        episode: With `wrench`, `wrench_raw` or `tcp_pose` at least.
        title: Plain text above the plot; may be empty.
        points: About how many points a line is drawn with.
        more: Drawn below, in place of the ledger.

    Raises:
        StreamError: If there is nothing to draw.
    """
    panels = [*_wrench_panels(episode), *_position_panels(episode)]
    if not panels:
        raise StreamError(
            f"episode {episode.id} has nothing to plot: expected samples in wrench, wrench_raw or tcp_pose. "
            f"It has: {', '.join(sorted(episode.streams)) or 'none'}."
        )
    lanes = {kind: _bands(kind, found) for kind in _LANES if (found := episode.events_of(kind))}
    ledger = Ledger.of(episode) if more is None else None
    below = more or (ledger_rows(ledger) if ledger else [])
    rows = [*([Strip(lanes=lanes)] if lanes else []), *panels, *below]
    tare = _tare(episode)
    zero_ns = tare.stop_ns if tare else episode.span_ns[0]
    # The rest before the tare is out of view until a second double click.
    first_ns, last_ns = tare.start_ns if tare else episode.span_ns[0], episode.span_ns[1]
    figure = time_figure(
        rows,
        title,
        zero_ns=zero_ns,
        view_ns=(first_ns, last_ns + (last_ns - first_ns) // 100),
        axis=f"time from the {'end of the tare' if tare else 'start of the recording'} [s]",
        points=points,
    )
    _shade(figure, episode, zero_ns)
    if ledger:
        shade_modes(figure, ledger, zero_ns)
    return figure


def _tare(episode: Episode) -> Event | None:
    return next((event for event in episode.events_of("phase") if event.label == "tare"), None)


def _wrench_panels(episode: Episode) -> list[Panel]:
    if "wrench" in episode and len(episode["wrench"]):
        causal = episode["wrench"]
        drawn = [(causal, "", MAIN)]
        if "wrench_zero_phase" in episode:
            drawn.append((episode["wrench_zero_phase"], " zero-phase", THIN))
        what = f"wrench, {causal.frame} axes" + ("; thin: zero-phase" if len(drawn) > 1 else "")
    elif "wrench_raw" in episode and len(episode["wrench_raw"]):
        raw, tare = episode["wrench_raw"], _tare(episode)
        rest = raw.between(tare.start_ns, tare.stop_ns).data if tare else raw.data[:0]
        bias = rest.mean(axis=0) if len(rest) else np.zeros(raw.signal.width)
        drawn = [(Stream(raw.t, raw.data - bias, raw.signal, raw.frame), "", THIN)]
        what = f"wrench_raw {'less its mean during the tare' if len(rest) else 'as read'}, {raw.frame} axes"
    else:
        return []
    return [
        Panel(quantity=quantity, what=what, unit=unit, lines=tuple(_lines(drawn, first)))
        for quantity, unit, first in (("force", "N", 0), ("moment", "N.m", 3))
        if first + 3 <= drawn[0][0].signal.width
    ]


def _lines(drawn: Sequence[tuple[Stream, str, Mapping[str, Any]]], first: int) -> list[Line]:
    return [
        Line(
            name=name + suffix,
            t_ns=stream.t,
            values=stream.data[:, first + axis],
            colour=theme.AXIS_COLOURS[axis],
            style=style,
            is_beside=bool(suffix),
        )
        for stream, suffix, style in drawn
        for axis, name in enumerate(stream.signal.columns[first : first + 3])
    ]


def _position_panels(episode: Episode) -> list[Panel]:
    if "tcp_pose" not in episode or not len(episode["tcp_pose"]):
        return []
    tcp, goal = episode["tcp_pose"], episode.streams.get("goal_pose")
    if goal is None or not len(goal) or goal.frame != tcp.frame:
        goal, origin = Stream(tcp.t[:1], tcp.data[:1], tcp.signal, tcp.frame), "where the recording starts"
    else:
        origin = "the perceived goal"
    drawn = [(_offset_mm(tcp, goal), "", MAIN)]
    target = episode.streams.get("target_pose")
    what = f"from {origin}, {tcp.frame} axes"
    if target is not None and target.frame == tcp.frame:
        drawn.append((_offset_mm(target, goal), " target", DASHED))
        what += "; dashed: target"
    return [Panel(quantity="TCP position", what=what, unit="mm", lines=tuple(_lines(drawn, 0)))]


def _offset_mm(pose: Stream, origin: Stream) -> Stream:
    """Poses with their position from the last `origin` known then, or the first one there is [mm]."""
    known = np.maximum(np.searchsorted(origin.t, pose.t, side="right") - 1, 0)
    data = pose.data.copy()
    data[:, :3] = 1e3 * (data[:, :3] - origin.data[known, :3])
    return Stream(pose.t, data, pose.signal, pose.frame)


def _bands(kind: str, events: Sequence[Event]) -> list[Band]:
    colours = {
        "contact": theme.CONTACT,
        "contact_mode": theme.CONTACT_MODE,
        "anomaly": theme.BAD,
        "intervention": theme.ACCENT,
    }
    return [
        Band(
            start_ns=event.start_ns,
            stop_ns=event.stop_ns,
            text=event.label,
            colour=theme.PHASE[number % 2] if kind == "phase" else colours[kind],
        )
        for number, event in enumerate(events)
    ]


def _shade(figure: Drawing, episode: Episode, zero_ns: int) -> None:
    shades = {"contact": theme.CONTACT_SHADE, "anomaly": theme.ANOMALY_SHADE}
    for kind, colour in shades.items():
        for event in episode.events_of(kind):
            shade(figure, event.start_ns, event.stop_ns, zero_ns, colour)
    for event in episode.events_of("phase")[1::2]:
        shade(figure, event.start_ns, event.stop_ns, zero_ns, theme.PHASE_SHADE)
    for kind, colour in (("success", theme.GOOD), ("failure", theme.BAD)):
        for event in episode.events_of(kind):
            mark(figure, event.stop_ns, zero_ns, f"{kind}: {event.label}" if event.label else kind, colour)
