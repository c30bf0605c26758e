"""A demonstration of each task over time: force, pose and target, phases shaded; writes a page with the figure.

Run it as `python benchmarks/task_figure.py OUT.html`; docs/tasks.png is a picture of that page, 800 pixels wide.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from plotly.graph_objects import Figure, Scatter
from plotly.subplots import make_subplots

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import demonstrate
from wrenchflow.episode import Episode, Stream
from wrenchflow.pages import theme
from wrenchflow.pages.drawing import Drawing
from wrenchflow.pages.page import page, section
from wrenchflow.pages.plot_block import plot_block
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.pipeline import process_episode
from wrenchflow.sim.tasks import NAMES
from wrenchflow.spatial import rotation_of

STEP = 10  # Every so many samples are drawn, of 1 kHz.
# Episodes of seed 0: the first, but of the connector the first whose plug has to be turned by more than a degree.
INDEX = {"peg-insertion": 0, "surface-wiping": 0, "connector-insertion": 2}
FLICKER_S = 0.1  # A phase that is shorter is drawn as part of the one before.
NORMAL, ASIDE, TURN = theme.AXIS_COLOURS[2], theme.COLOURS[5], theme.COLOURS[3]
SHADES = ("rgba(128,138,150,0.0)", "rgba(128,138,150,0.14)")
PANEL_PX, GAP_PX, TOP_PX = 180, 92, 70
_LETTER_S = 0.0185  # As wide as a letter of a phase's name, of the time that is shown.

type Curve = tuple[str, np.ndarray, str]  # name, values, colour
type Span = tuple[str, float, float]  # name, from, to [s]


@dataclass(frozen=True, kw_only=True, eq=False)
class Shown:
    """What is drawn of one demonstration, in the axes of the goal as it is perceived, whose z points into the surface.

    Attributes:
        t_s: From the end of the tare. Shape (n,).
        phases: What the person thinks to be doing.
        wrench: What the robot exerts, tared, without the tool's weight, low-passed [N, N.m]. Shape (n, 6).
        tcp: x, y, height [mm] and yaw [deg] of the tool. Shape (n, 4).
        target: The same of what was asked for.
    """

    t_s: np.ndarray
    phases: Sequence[Span]
    wrench: np.ndarray
    tcp: np.ndarray
    target: np.ndarray


def shown_of(episode: Episode) -> Shown:
    """Put one demonstration into the goal's axes."""
    wrench = process_episode(episode, ProcessConfig())[0]["wrench"]
    goal = episode["goal_pose"].data[0]
    R_goal = rotation_of(goal[3:])
    start_ns = max(event.stop_ns for event in episode.events_of("phase") if event.label == "tare")
    t = np.arange(start_ns, int(episode["tcp_pose"].t[-1]), STEP * 1_000_000)

    def at(stream: Stream) -> np.ndarray:
        return stream.data[np.minimum(np.searchsorted(stream.t, t), len(stream) - 1)]

    def pose(stream: Stream) -> np.ndarray:
        poses = at(stream)
        places_mm = 1e3 * (poses[:, :3] - goal[:3]) @ R_goal * [1.0, 1.0, -1.0]
        turns = [R_goal.T @ rotation_of(each[3:]) for each in poses]
        return np.column_stack([places_mm, np.degrees([np.arctan2(R[1, 0], R[0, 0]) for R in turns])])

    felt = at(wrench)
    return Shown(
        t_s=(t - start_ns) * 1e-9,
        phases=_phases(episode, start_ns),
        wrench=np.hstack([felt[:, :3] @ R_goal, felt[:, 3:] @ R_goal]),
        tcp=pose(episode["tcp_pose"]),
        target=pose(episode["target_pose"]),
    )


def _phases(episode: Episode, start_ns: int) -> list[Span]:
    spans: list[Span] = []
    for event in episode.events_of("phase"):
        if event.label == "tare":
            continue
        begin, end = (event.start_ns - start_ns) * 1e-9, (event.stop_ns - start_ns) * 1e-9
        if spans and (spans[-1][0] == event.label or end - begin < FLICKER_S):
            spans[-1] = (spans[-1][0], spans[-1][1], end)
        else:
            spans.append((event.label, begin, end))
    return spans


def figure_of(shown: Sequence[Shown], titles: Sequence[str]) -> Figure:
    """Draw peg, wiping and connector, in this order: a row each, and one more for the turn of the connector."""
    peg, wiping, plug = shown
    rows = [
        (titles[0], peg, _force(peg), _place(peg)),
        (titles[1], wiping, _force(wiping), _place(wiping)),
        (titles[2], plug, _force(plug), _place(plug)),
        ("", plug, [("moment about the plug", 1e3 * plug.wrench[:, 5], TURN)], [("yaw", plug.tcp[:, 3], TURN)]),
    ]
    height_px = len(rows) * PANEL_PX + (len(rows) - 1) * GAP_PX
    figure = make_subplots(len(rows), 2, vertical_spacing=GAP_PX / height_px, horizontal_spacing=0.09)
    units = (("N", "mm"),) * 3 + (("mN.m", "deg"),)
    for row, ((title, of, left, right), named) in enumerate(zip(rows, units, strict=True), start=1):
        for column, (curves, unit) in enumerate(zip((left, right), named, strict=True), start=1):
            _draw(figure, of, curves, unit, row, column)
        if title:
            place = {"x": -0.05, "xref": "x domain", "xanchor": "left", "y": 1.26, "yref": "y domain"}
            figure.add_annotation(
                text=f"<b>{title}</b>", font_size=14, yanchor="bottom", showarrow=False, row=row, col=1, **place
            )
    for row, of in enumerate((peg, wiping, plug), start=1):
        _dash(figure, of, _place(of, of.target), row)
    _dash(figure, plug, [("yaw", plug.target[:, 3], TURN)], 4)
    _limit(figure, 25.0, "marked from 25 N on", 1)
    _limit(figure, 6.0, "", 2)
    _limit(figure, 10.0, "8 ± 2 N", 2)
    _limit(figure, 30.0, "never 30 N", 3)
    _limit(figure, 13.0, "snaps at 13 N", 3)
    figure.update_xaxes(zeroline=False, showgrid=False, ticks="outside", ticklen=3)
    figure.update_yaxes(zeroline=True, zerolinecolor="rgba(128,138,150,0.45)", gridcolor="rgba(128,138,150,0.18)")
    figure.update_xaxes(
        title={"text": "time since the tare [s]", "font": {"size": 12}}, title_standoff=4, row=len(rows)
    )
    for row, top_n in enumerate((28.5, 12.0, 37.0), start=1):
        figure.update_yaxes(range=[-1.0, top_n], row=row, col=1)
    figure.update_layout(theme.plot_layout(height_px, top_px=TOP_PX, margin_l=38, margin_r=8))
    return figure


def _force(of: Shown) -> list[Curve]:
    aside = np.hypot(of.wrench[:, 0], of.wrench[:, 1])
    return [("normal", of.wrench[:, 2], NORMAL), ("lateral", aside, ASIDE)]


def _place(of: Shown, values: np.ndarray | None = None) -> list[Curve]:
    x, y, height, _ = (of.tcp if values is None else values).T
    return [("x", x, theme.AXIS_COLOURS[0]), ("y", y, theme.AXIS_COLOURS[1]), ("height", height, theme.AXIS_COLOURS[2])]


def _draw(figure: Figure, of: Shown, curves: Sequence[Curve], unit: str, row: int, column: int) -> None:
    for name, values, colour in curves:
        style = {"width": 1.6, "color": colour}
        figure.add_trace(
            Scatter(x=of.t_s, y=values, name=name, mode="lines", line=style, showlegend=False), row=row, col=column
        )
    names = " ".join(f'<span style="color:{colour}"><b>{name}</b></span>' for name, _, colour in curves)
    what = "force" if unit == "N" else "from the goal" if unit == "mm" else ""
    text = " ".join(filter(None, (what, names, f"[{unit}]", "· dashed: target" if column == 2 else "")))
    top = {"xref": "x domain", "yref": "y domain", "showarrow": False, "row": row, "col": column}
    figure.add_annotation(text=text, x=0, xanchor="left", y=1.11, yanchor="bottom", font_size=12, **top)
    end_s = float(of.t_s[-1])
    figure.update_xaxes(range=[0.0, end_s], row=row, col=column)
    for number, (name, begin, end) in enumerate(of.phases):
        figure.add_vrect(begin, end, fillcolor=SHADES[number % 2], line_width=0, layer="below", row=row, col=column)
        if end - begin > _LETTER_S * len(name) * end_s:
            middle = {"x": (begin + min(end, end_s)) / 2, "y": 1.0, "yref": "y domain", "yanchor": "bottom"}
            figure.add_annotation(text=name, font_size=11, showarrow=False, row=row, col=column, **middle)


def _dash(figure: Figure, of: Shown, curves: Sequence[Curve], row: int) -> None:
    for name, values, colour in curves:
        style = {"width": 1.3, "color": colour, "dash": "3px,2px"}
        line = Scatter(x=of.t_s, y=values, name=f"{name}, target", mode="lines", line=style, showlegend=False)
        figure.add_trace(line, row=row, col=2)


def _limit(figure: Figure, force_n: float, text: str, row: int) -> None:
    line = {"color": theme.BAD, "width": 1.2, "dash": "dot"}
    figure.add_hline(force_n, line=line, row=row, col=1)
    if text:
        place = {"x": 0.01, "xref": "x domain", "xanchor": "left", "y": force_n, "yanchor": "bottom"}
        figure.add_annotation(
            text=text, font={"color": theme.BAD, "size": 11}, showarrow=False, row=row, col=1, **place
        )


def main() -> None:
    """Demonstrate and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("page", type=Path, help="where the page goes")
    parser.add_argument("--person", default="steady", help="a profile")
    arguments = parser.parse_args()
    shown = []
    for task in NAMES:
        config = CollectConfig(task=task, operator="emulated", profiles=(arguments.person,), seed=0)
        shown.append(shown_of(demonstrate(INDEX[task], config)))
    block = plot_block(Drawing(**figure_of(shown, NAMES).to_plotly_json()), "tasks")
    arguments.page.write_text(page("A demonstration of each task", [section("", block)], ""))


if __name__ == "__main__":
    main()
