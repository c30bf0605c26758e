"""The safety layer's ledger over time: energy, work by kind, and a strip of modes and interventions."""

from collections.abc import Sequence

import numpy as np

from wrenchflow.episode import Episode
from wrenchflow.errors import StreamError
from wrenchflow.ledger import WORK, Ledger
from wrenchflow.pages import theme
from wrenchflow.pages.drawing import Drawing
from wrenchflow.pages.time_plot import MAIN, POINTS, Band, Line, Panel, Strip, shade, time_figure

# Each row has a scale of its own: the tank holds far more than the spring. What the tank is given while plans come in
# time grows by a joule a second, and would hide all other work.
_WORK = tuple(name for name in WORK if name != "filled")
_DRAWN = ("tank", "spring", "kinetic", "fed", "posed", "exerted", "saturated", "damped")
_COLOURS: dict[str, str] = dict(zip(_DRAWN, theme.COLOURS, strict=True))
_NOTHING_J = 1e-4
_TANK_PX, _PANEL_PX, _LANE_PX = 80, 140, 22
_BANDS = 400  # About as many bands as a lane can show apart.


def ledger_figure(episode: Episode, title: str, *, points: int = POINTS) -> Drawing:
    """Draw what the safety layer did in an episode, from its start on; `episode_figure` shows it below the force.

    Args:
        episode: With the stream `governor`, and what its numbers mean in `meta["governor"]`.
        title: Plain text above the plot; may be empty.
        points: About how many points a line is drawn with.

    Raises:
        StreamError: If no safety layer was recorded.
    """
    ledger = Ledger.of(episode)
    if ledger is None:
        raise StreamError(f"episode {episode.id} has no ledger: expected samples in governor, with names in its meta.")
    t = ledger.governor.t
    first_ns, last_ns = int(t[0]), int(t[-1])
    figure = time_figure(
        ledger_rows(ledger),
        title,
        zero_ns=first_ns,
        view_ns=(first_ns, last_ns + (last_ns - first_ns) // 100),
        axis="time from the start of the recording [s]",
        points=points,
    )
    shade_modes(figure, ledger, first_ns)
    return figure


def ledger_rows(ledger: Ledger) -> list[Panel | Strip]:
    """Energy there is [J], work since the start by kind [J], and a lane for modes and each safeguard that acted."""
    work = {name: values for name in _WORK if np.abs(values := ledger.governor.column(name)).max() >= _NOTHING_J}
    little = [name for name in _WORK if name not in work]
    less = f"; under {1e3 * _NOTHING_J:g} mJ: {', '.join(little)}" if little else ""
    return [
        _panel(ledger, "energy", "", ("tank",), _TANK_PX),
        _panel(ledger, "energy", "", ("spring", "kinetic"), _PANEL_PX),
        _panel(ledger, "work", f"since the start{less}", tuple(work), _PANEL_PX),
        _strip(ledger),
    ]


def shade_modes(figure: Drawing, ledger: Ledger, zero_ns: int) -> None:
    """Shade all rows where the mode is not the ordinary one."""
    for stretch in ledger.mode_stretches:
        if stretch.label not in ledger.ordinary:
            shade(figure, stretch.start_ns, stretch.stop_ns, zero_ns, theme.mode_colour(stretch.label, 0.13))


def _panel(ledger: Ledger, quantity: str, what: str, names: Sequence[str], height_px: int) -> Panel:
    lines = tuple(
        Line(name=name, t_ns=ledger.governor.t, values=ledger.governor.column(name), colour=_COLOURS[name], style=MAIN)
        for name in names
    )
    return Panel(quantity=quantity, what=what, unit="J", lines=lines, height_px=height_px, has_zero=True)


def _strip(ledger: Ledger) -> Strip:
    modes = [
        Band(
            start_ns=stretch.start_ns,
            stop_ns=stretch.stop_ns,
            colour=theme.mode_colour(stretch.label, 0.25 if stretch.label in ledger.ordinary else 0.85),
            # What comes before anything was asked begins out of view, and its name would be cut in half.
            text="" if stretch.label == ledger.ordinary[1] else stretch.label,
            hover=stretch.label,
        )
        for stretch in ledger.mode_stretches
    ]
    t = ledger.governor.t
    gap_ns = int(t[-1] - t[0]) // _BANDS
    acted = {
        name: [
            Band(
                start_ns=stretch.start_ns,
                stop_ns=stretch.stop_ns,
                colour=theme.ACCENT,
                hover=f"{name}, {stretch.ticks} tick{'' if stretch.ticks == 1 else 's'},",
            )
            for stretch in stretches
        ]
        for name, stretches in ledger.interventions(gap_ns).items()
    }
    return Strip(lanes={"mode": modes, **acted}, lane_px=_LANE_PX)
