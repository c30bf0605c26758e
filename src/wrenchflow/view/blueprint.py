"""How the window is laid out: space and cameras to the left; lanes, force, torque and all other plots to the right."""

from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb

from wrenchflow.view.contents import EVENTS, TIMELINE, WORLD, Contents, Series
from wrenchflow.view.style import ARROW_M_PER_N

# What a person compares is drawn in one plot: streams, and the title of what they have in common.
_COMPARED = {
    "wrench": ("wrench", "wrench_zero_phase"),
    "tcp and its target": ("tcp_pose", "target_pose"),
    "safety layer": ("governor",),
    "given and asked": ("impedance", "request"),
}
# Numbers of safeguards, which are no lines: they are there for who looks for them.
_UNPLOTTED = ("cause", "acting")
_RECENT_S = 10.0
_EYE_DIRECTION = np.array([0.7, -0.6, 0.4])


def make_blueprint(contents: Contents, *, live: bool = False) -> rrb.Blueprint:
    """A window for what there is to see; views that would stay empty are left out.

    Args:
        contents: What there is to see.
        live: Follow the newest samples, and plot the last ten seconds only.
    """
    plots = _plots(contents, live)
    first = [plot for is_force, plot in plots if is_force][:2]
    others = [plot for _, plot in plots if plot not in first]
    right: list[tuple[rrb.View | rrb.Container, float]] = []
    if contents.lanes:
        right.append((_lanes(contents), 0.5 + 0.4 * len(contents.lanes)))
    right += [(plot, 2.0) for plot in first]
    if others:
        right.append((rrb.Tabs(*others, active_tab=0), 2.0))
    left: list[tuple[rrb.View | rrb.Container, float]] = []
    if contents.poses:
        left.append((_space(contents), 3.0))
    if contents.cameras:
        images = [rrb.Spatial2DView(origin=f"/{name}", name=name) for name in contents.cameras]
        left.append((rrb.Horizontal(*images) if len(images) > 1 else images[0], 2.0))
    halves = [_column(half) for half in (left, right) if half]
    return rrb.Blueprint(
        rrb.Horizontal(*halves, column_shares=[2, 3][: len(halves)]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="following" if live else "paused"),
        auto_views=False,
        auto_layout=False,
    )


def _column(parts: Sequence[tuple[rrb.View | rrb.Container, float]]) -> rrb.Container:
    return rrb.Vertical(*(part for part, _ in parts), row_shares=[share for _, share in parts])


def _space(contents: Contents) -> rrb.View:
    frame = contents.streams[contents.poses[0]][1]
    title = f"Space: {frame} axes" if frame else "Space"
    if contents.arrow:
        what = "exerted force" if contents.arrow == "wrench" else "force as the sensor reads"
        title += f"; arrow: {what}, {100 * ARROW_M_PER_N:g} cm a newton"
    return rrb.Spatial3DView(
        origin=WORLD,
        name=title,
        line_grid=rrb.LineGrid3D(spacing=0.1, color=(90, 96, 104, 60)),
        eye_controls=_eye(contents),
    )


def _eye(contents: Contents) -> rrb.EyeControls3D | None:
    """From the front, the right and above, far enough to see the whole path."""
    if contents.box_m is None:
        return None
    low, high = contents.box_m
    distance_m = 0.14 + 1.1 * float(np.linalg.norm(high - low))
    centre = (low + high) / 2
    return rrb.EyeControls3D(position=centre + distance_m * _EYE_DIRECTION, look_target=centre, eye_up=(0.0, 0.0, 1.0))


def _lanes(contents: Contents) -> rrb.View:
    shown = [f"{EVENTS}/{kind}" for kind in contents.lanes]
    return rrb.StateTimelineView(
        origin=EVENTS, contents=shown, name="; ".join([" and ".join(contents.lanes).capitalize(), *contents.instants])
    )


def _plots(contents: Contents, live: bool) -> list[tuple[bool, rrb.View]]:
    """All plots, and of each whether it shows force or torque of a wrench that is looked at first."""
    place = {stream: title for title, streams in _COMPARED.items() for stream in streams}
    groups: dict[tuple[str, str], list[Series]] = {}
    order = list(place)  # What is compared is first.
    shown = [series for series in contents.series if series.quantity not in _UNPLOTTED]
    for series in sorted(shown, key=lambda of: order.index(of.stream) if of.stream in place else len(order)):
        groups.setdefault((place.get(series.stream, series.stream), series.quantity), []).append(series)
    recent = rrb.VisibleTimeRange(
        TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-_RECENT_S),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )
    views = []
    for (title, quantity), group in groups.items():
        units = dict.fromkeys(unit for series in group for unit in series.units)
        view = rrb.TimeSeriesView(
            origin="/",
            contents=[series.entity for series in group],
            name=f"{quantity.replace('_', ' ').capitalize()} [{', '.join(units)}]: {title}",
            plot_legend=rrb.PlotLegend("LeftBottom"),
            axis_x=rrb.TimeAxis(link="LinkToGlobal"),
            time_ranges=recent if live else None,
        )
        views.append((group[0].stream in contents.forces and quantity in ("force", "torque"), view))
    return views
