"""The plot of one episode: its time, its rows, its bands, and what it does without."""

import numpy as np
import pytest
from plotly.graph_objects import Figure

from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import StreamError
from wrenchflow.pages import episode_plot
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.pipeline import process_episode
from wrenchflow.signals import POSE

ZERO_NS = 5_500_000_000  # Where the fixture's tare ends.


def clean(episode: Episode) -> Episode:
    return process_episode(episode, ProcessConfig())[0]


def with_pose(episode: Episode, name: str, position_m: list[float]) -> Episode:
    t = episode["tcp_pose"].t[:1]
    return episode.with_stream(name, Stream(t, np.array([[*position_m, 1.0, 0.0, 0.0, 0.0]]), POSE, "base"))


def episode_figure(episode: Episode, title: str, *, points: int = 1000) -> Figure:
    """As plotly's own objects, which take nothing that plotly does not know."""
    drawing = episode_plot.episode_figure(episode, title, points=points)
    return Figure(drawing.data, drawing.layout)


def traces(figure) -> dict[str, object]:
    return {trace.name: trace for trace in figure.data if trace.type == "scatter"}


def captions(figure) -> str:
    return " ".join(annotation.text for annotation in figure.layout.annotations)


def test_the_push_is_seen_where_it_was_with_time_from_the_end_of_the_tare(recording):
    episode = clean(recording(push_n=(0.0, 3.0, -10.0), noise=0.0))
    drawn = traces(episode_figure(episode, ""))
    fz = drawn["fz zero-phase"]
    inside = (fz.x > 0.55) & (fz.x < 0.95)  # 1.0 to 1.5 s of the recording, whose tare ends after 0.5 s.
    assert fz.y[inside] == pytest.approx(-10.0, abs=0.05)
    assert np.abs(fz.y[(fz.x > 0.0) & (fz.x < 0.4)]).max() < 0.05
    assert {"fx", "fy", "fz", "tx", "ty", "tz", "tx zero-phase"} <= set(drawn)


def test_a_peak_of_one_sample_survives_the_thinning(recording):
    episode = clean(recording(noise=0.0))
    data = episode["wrench"].data.copy()
    data[1733, 1] = 77.0
    wrench = episode["wrench"]
    figure = episode_figure(episode.with_stream("wrench", Stream(wrench.t, data, wrench.signal, "base")), "", points=50)
    fy = traces(figure)["fy"]
    assert len(fy.y) <= 52
    assert fy.y.max() == 77.0
    assert fy.x[fy.y.argmax()] == pytest.approx(1.233, abs=1e-6)


def test_without_wrench_the_raw_one_is_tared(recording, true_bias):
    episode = recording(noise=0.0)
    figure = episode_figure(episode, "")
    assert "less its mean during the tare, sensor axes" in captions(figure)
    fx = traces(figure)["fx"]
    assert fx.y[fx.x < 0] == pytest.approx(0.0, abs=1e-6)


def test_without_a_tare_nothing_is_taken_off_and_the_plot_says_so(recording):
    raw = recording(noise=0.0)
    episode = Episode(raw.id, raw.task, raw.streams)
    figure = episode_figure(episode, "")
    assert "as read" in captions(figure)
    assert traces(figure)["fx"].y[0] == pytest.approx(raw["wrench_raw"].data[0, 0], abs=1e-5)
    assert figure.layout.xaxis3.title.text == "time from the start of the recording [s]"


def test_a_force_only_sensor_has_no_moment(recording):
    figure = episode_figure(clean(recording(force_only=True)), "")
    assert "tx" not in traces(figure)
    assert "moment" not in captions(figure)


def test_position_is_from_the_goal_and_the_target_is_dashed(recording):
    episode = with_pose(with_pose(recording(), "goal_pose", [0.49, 0.01, 0.25]), "target_pose", [0.49, 0.01, 0.24])
    drawn = traces(episode_figure(episode, ""))
    assert [drawn[name].y[0] for name in "xyz"] == pytest.approx([10.0, -10.0, 50.0], abs=1e-4)
    assert drawn["z target"].y[0] == pytest.approx(-10.0, abs=1e-4)
    assert drawn["z target"].line.dash
    assert not drawn["z"].line.dash


def test_a_goal_that_moves_counts_from_when_it_does(recording):
    episode = recording()
    t = episode["tcp_pose"].t[[0, 1000]]
    goal = np.array([[0.5, 0.0, 0.3, 1, 0, 0, 0], [0.4, 0.0, 0.3, 1, 0, 0, 0]])
    x = traces(episode_figure(episode.with_stream("goal_pose", Stream(t, goal, POSE, "base")), "", points=5000))["x"]
    assert x.y[999:1001] == pytest.approx([0.0, 100.0], abs=1e-4)


@pytest.mark.parametrize("frame", ["", "camera"])
def test_without_a_goal_in_its_frame_position_is_from_the_start(recording, frame):
    episode = recording()
    if frame:
        pose = np.array([[9.0, 9.0, 9.0, 1, 0, 0, 0]])
        episode = episode.with_stream("goal_pose", Stream(episode["tcp_pose"].t[:1], pose, POSE, frame))
    figure = episode_figure(episode, "")
    assert "where the recording starts" in captions(figure)
    assert traces(figure)["x"].y[0] == 0.0


def test_events_are_bands_with_their_labels(recording):
    end = Event(ZERO_NS + 10**9, ZERO_NS + 10**9, "failure", "jammed")
    spike = Event(ZERO_NS + 2 * 10**8, ZERO_NS + 3 * 10**8, "anomaly", "spike")
    figure = episode_figure(clean(recording()).with_events(end, spike), "")
    bands = {trace.y[0]: trace for trace in figure.data if trace.type == "bar"}
    assert set(bands) == {"phase", "contact", "contact_mode", "anomaly"}
    assert bands["phase"].text == ("tare",)
    assert bands["contact"].base[0] == pytest.approx(0.5, abs=0.02)
    assert bands["contact"].x[0] == pytest.approx(0.5, abs=0.04)
    shaded = {(round(shape.x0, 1), round(shape.x1, 1)) for shape in figure.layout.shapes}
    assert shaded == {(0.2, 0.3), (0.5, 1.0), (1.0, 1.0)}
    assert "failure: jammed" in captions(figure)


def test_text_from_a_file_is_no_markup(recording):
    episode = recording().with_events(Event(ZERO_NS, ZERO_NS + 10**8, "phase", "<b>x</b>"))
    figure = episode_figure(episode, "<i>t</i>")
    assert figure.data[0].text == ("tare", "&lt;b&gt;x&lt;/b&gt;")
    assert figure.layout.title.text == "&lt;i&gt;t&lt;/i&gt;"


def test_nothing_to_draw_is_refused():
    with pytest.raises(StreamError, match=r"episode 0001 has nothing to plot: .* It has: none\."):
        episode_figure(Episode("0001", "push"), "")
