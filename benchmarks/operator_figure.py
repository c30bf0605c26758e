"""The figure of `operator_realism.py`: spread between people, speed with its submovements, spectra beside real ones."""

from collections.abc import Mapping, Sequence
from html import escape

import numpy as np
from plotly.graph_objects import Box, Figure, Scatter
from plotly.subplots import make_subplots

from operator_takes import BANDS_HZ, FORCE_KNOWN_HZ, MOTION_KNOWN_HZ, TREMOR, Take
from wrenchflow.pages import theme

SPREAD = ("peak force [N]", "duration [s]", "path [m]")
REAL = "real hand"
_NEUTRAL = "#7a828c"
_SHOWN_S = 8.0
_SPECTRA = {"force_spectrum": FORCE_KNOWN_HZ, "motion_spectrum": MOTION_KNOWN_HZ}
_TITLES = ("force in contact, share a Hz", "velocity of the tool, share a Hz", "smoothness of the speed (SPARC)")


def figure_of(takes: Mapping[str, Sequence[Take]], told: Mapping[str, Sequence[Mapping[str, float]]]) -> Figure:
    """Draw takes.

    Args:
        takes: Of each person; those of real hands under `REAL`, if there are any.
        told: The figures of each take, in the same order.
    """
    people = [who for who in takes if who != REAL]
    colours = dict(zip(people, (theme.COLOURS[i] for i in (0, 1, 2, 3, 4)), strict=True)) | {REAL: _NEUTRAL}
    shown = [*people, REAL] if REAL in takes else people
    speeds = [f"speed [mm/s], {who}" for who in _speakers(people, shown)]
    titles = [*SPREAD, *speeds, *_TITLES]
    figure = make_subplots(3, 3, subplot_titles=titles, vertical_spacing=0.13, horizontal_spacing=0.07)
    for column, name in enumerate(SPREAD, start=1):
        for who in people:
            figure.add_trace(
                Box(
                    y=[each[name] for each in told[who]],
                    name=who,
                    boxpoints="all",
                    jitter=0.5,
                    pointpos=0,
                    marker={"size": 3, "color": colours[who], "opacity": 0.6},
                    line={"width": 1.2, "color": colours[who]},
                    showlegend=False,
                ),
                row=1,
                col=column,
            )
        figure.update_yaxes(rangemode="tozero", row=1, col=column)
    for column, who in enumerate(_speakers(people, shown), start=1):
        _draw_speed(figure, _middle(takes[who]), colours[who], column)
    for column, (kind, known_hz) in enumerate(_SPECTRA.items(), start=1):
        for who in shown:
            hz, power = _mean_spectrum([getattr(take, kind)() for take in takes[who]], known_hz)
            style = {"color": colours[who], "width": 2.6 if who == REAL else 1.4}
            line = Scatter(x=hz, y=power, name=who, mode="lines", line=style, showlegend=column == 1)
            figure.add_trace(line, row=3, col=column)
        low, high = BANDS_HZ[TREMOR]
        figure.add_vrect(low, high, fillcolor=theme.PHASE_SHADE, line_width=0, row=3, col=column)
        figure.update_xaxes(type="log", title_text="Hz", range=[np.log10(1.9), np.log10(known_hz)], row=3, col=column)
        figure.update_xaxes(tickvals=[1, 2, 5, 10, 20, 40], row=3, col=column)
        figure.update_yaxes(type="log", exponentformat="power", dtick=1, row=3, col=column)
    _draw_rates(figure, told, shown, colours)
    figure.update_xaxes(zeroline=False)
    figure.update_yaxes(zeroline=False, gridcolor="rgba(128,138,150,0.18)")
    figure.update_annotations(font_size=13)
    figure.update_layout(theme.plot_layout(820, top_px=40))
    figure.update_layout(
        legend={"orientation": "h", "x": 0.3, "xanchor": "center", "y": -0.07, "yanchor": "top"}, margin_b=90
    )
    return figure


def _speakers(people: Sequence[str], shown: Sequence[str]) -> list[str]:
    """Whose speed is drawn: two people who differ, and the real hand, or else a third."""
    return [people[1], people[-1], REAL if REAL in shown else people[0]]


def _middle(takes: Sequence[Take]) -> Take:
    """The one of median duration, of those that pressed on something."""
    takes = [take for take in takes if take.touches.mean() > 0.1]
    return sorted(takes, key=lambda take: len(take.position_m) / take.rate_hz)[len(takes) // 2]


def _draw_speed(figure: Figure, take: Take, colour: str, column: int) -> None:
    speed, peaks = take.speed_m_s * 1e3, take.submovements
    t_s, until = np.arange(len(speed)) / take.rate_hz, round(_SHOWN_S * take.rate_hz)
    step = max(1, round(take.rate_hz / 100))
    line = {"color": colour, "width": 1.6}
    figure.add_trace(
        Scatter(x=t_s[:until:step], y=speed[:until:step], mode="lines", line=line, showlegend=False), row=2, col=column
    )
    inside = peaks[peaks < until]
    marker = {"color": colour, "size": 7, "symbol": "triangle-down"}
    figure.add_trace(
        Scatter(x=t_s[inside], y=speed[inside], mode="markers", marker=marker, showlegend=False), row=2, col=column
    )
    touched = np.flatnonzero(take.touches[:until]) / take.rate_hz
    if take.success is not None and len(touched):
        figure.add_vrect(touched[0], touched[-1], fillcolor=theme.CONTACT_SHADE, line_width=0, row=2, col=column)
        figure.add_annotation(
            text="in contact",
            x=touched[-1],
            y=1,
            yref="y domain",
            xanchor="right",
            yanchor="top",
            showarrow=False,
            row=2,
            col=column,
        )
    figure.update_xaxes(title_text="s", range=[0, min(_SHOWN_S, t_s[-1])], row=2, col=column)
    figure.update_yaxes(rangemode="tozero", row=2, col=column)


def _mean_spectrum(each: Sequence[tuple[np.ndarray, np.ndarray]], known_hz: float) -> tuple[np.ndarray, np.ndarray]:
    hz = each[0][0]
    inside = (hz > 0.0) & (hz <= known_hz)
    shares = [power[inside] / (power[inside].sum() * hz[1]) for _, power in each if np.isfinite(power).all()]
    return hz[inside], np.mean(shares, axis=0)


def _draw_rates(figure: Figure, told: Mapping, shown: Sequence[str], colours: Mapping[str, str]) -> None:
    for who in shown:
        figure.add_trace(
            Scatter(
                x=[each["submovements / s"] for each in told[who]],
                y=[each["SPARC"] for each in told[who]],
                name=escape(who),
                mode="markers",
                marker={
                    "color": colours[who],
                    "size": 9 if who == REAL else 5,
                    "opacity": 0.8,
                    "symbol": "diamond" if who == REAL else "circle",
                },
                showlegend=False,
            ),
            row=3,
            col=3,
        )
    figure.update_xaxes(title_text="submovements a second", rangemode="tozero", row=3, col=3)
