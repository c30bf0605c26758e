"""The plot of the safety layer's ledger: energy and work as they are, modes shaded, a lane for what acted at all."""

import numpy as np
import pytest
from plotly.graph_objects import Figure

from wrenchflow.control.safeguards import HOLD, LEASH, MODES, NO_CAUSE, RUN, SAFEGUARDS, SILENCE, SPEED
from wrenchflow.episode import Episode, Stream
from wrenchflow.errors import StreamError
from wrenchflow.pages import episode_plot, ledger_plot
from wrenchflow.pages.attempts import attempts_section
from wrenchflow.pages.drawing import Drawing
from wrenchflow.signals import GOVERNOR

TICK = 1_000_000


def governed(episode: Episode) -> Episode:
    """The fixture's two seconds: waiting for 0.5 s, then running, held from 1.5 s on; the leash acted twice."""
    t = episode["tcp_pose"].t
    data = np.zeros((len(t), GOVERNOR.width))
    column = {name: data[:, k] for k, name in enumerate(GOVERNOR.columns)}
    column["mode"][:] = np.repeat([HOLD, RUN, HOLD], [500, 1000, 500])
    column["cause"][:] = np.repeat([NO_CAUSE, NO_CAUSE, SILENCE], [500, 1000, 500])
    column["acting"][600:700] = 1 << LEASH
    column["acting"][1200:1201] = 1 << LEASH | 1 << SPEED
    column["tank"][:] = np.linspace(2.0, 1.0, len(t))
    column["spring"][777] = 0.25
    column["damped"][:] = np.linspace(0.0, 0.5, len(t))
    column["fed"][:] = 5e-5
    names = {"modes": list(MODES), "safeguards": list(SAFEGUARDS)}
    return episode.with_stream("governor", Stream(t, data, GOVERNOR, "base")).with_meta(governor=names)


def as_plotly(drawing: Drawing) -> Figure:
    """As plotly's own objects, which take nothing that plotly does not know."""
    return Figure(drawing.data, drawing.layout)


def episode_figure(episode: Episode, title: str) -> Figure:
    return as_plotly(episode_plot.episode_figure(episode, title))


def ledger_figure(episode: Episode, title: str, *, points: int = 1000) -> Figure:
    return as_plotly(ledger_plot.ledger_figure(episode, title, points=points))


def lines(figure) -> dict[str, object]:
    return {trace.name: trace for trace in figure.data if trace.type == "scatter"}


def lanes(figure) -> dict[str, object]:
    return {trace.y[0]: trace for trace in figure.data if trace.type == "bar"}


def captions(figure) -> str:
    return " ".join(annotation.text for annotation in figure.layout.annotations)


def test_energy_and_work_are_drawn_with_their_peaks_and_what_is_nothing_is_only_named(recording):
    figure = ledger_figure(governed(recording()), "", points=60)
    drawn = lines(figure)
    assert set(drawn) == {"tank", "spring", "kinetic", "damped"}
    assert (drawn["tank"].y[0], drawn["tank"].y[-1]) == (2.0, 1.0)
    assert (drawn["spring"].y.max(), drawn["spring"].x[drawn["spring"].y.argmax()]) == (0.25, pytest.approx(0.777))
    assert "under 0.1 mJ: fed, posed, saturated, exerted" in captions(figure)


def test_there_is_a_lane_for_the_modes_and_for_each_safeguard_that_acted(recording):
    bands = lanes(ledger_figure(governed(recording()), ""))
    assert list(bands) == ["mode", "leash", "speed"]
    assert list(bands["mode"].customdata) == ["waiting", "run", "hold: silence"]
    assert list(bands["mode"].base) == pytest.approx([0.0, 0.5, 1.5])
    assert list(bands["leash"].base) == pytest.approx([0.6, 1.2])
    assert list(bands["leash"].x) == pytest.approx([0.1, 0.001])
    assert list(bands["leash"].customdata) == ["leash, 100 ticks,", "leash, 1 tick,"]


def test_modes_that_are_not_ordinary_are_shaded(recording):
    figure = ledger_figure(governed(recording()), "")
    assert [(shape.x0, shape.x1) for shape in figure.layout.shapes] == [(pytest.approx(1.5), pytest.approx(1.999))]


def test_an_episodes_page_shows_it_below_the_force_with_the_same_time(recording):
    plain, with_ledger = episode_figure(recording(), ""), episode_figure(governed(recording()), "")
    assert set(lines(with_ledger)) - set(lines(plain)) == {"tank", "spring", "kinetic", "damped"}
    assert lines(with_ledger)["tank"].x[0] == pytest.approx(-0.5)  # Time counts from the end of the tare.
    assert with_ledger.layout.height > plain.layout.height
    assert with_ledger.layout.xaxis.range == plain.layout.xaxis.range
    assert "hold: silence" in attempts_section("Rollouts", [(governed(recording()), "x.mcap")], name="r", text="")


def test_without_a_ledger_it_is_refused(recording):
    with pytest.raises(StreamError, match="episode 0007 has no ledger: expected samples in governor"):
        ledger_figure(recording(), "")
