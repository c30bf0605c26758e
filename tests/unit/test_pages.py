"""The pages as HTML: well formed, without a network, with every figure, the same at each run."""

import json

import pytest

from browsing.document import assert_needs_no_network, read
from wrenchflow.deploy.evaluation import Verdict, summarise
from wrenchflow.episode import Episode, Event
from wrenchflow.pages.evaluation import evaluation_page
from wrenchflow.pages.plot_block import plot_block
from wrenchflow.pages.quickstart import quickstart_page
from wrenchflow.pages.result_plots import peak_force_figure, training_figure
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.pipeline import process_episode

LINKS = [("Raw recordings", "raw/"), ("The HDF5 file", "dataset/robomimic.hdf5")]


@pytest.fixture
def summary() -> dict:
    return {
        "task": "peg-insertion",
        "episodes": 301,
        "samples": 1167342,
        "success_rate": 0.935,
        "success_interval": [0.892, 0.962],
        "successes": 187,
        "rollouts": 200,
        "peak_force_n": {"median": 9.83, "p95": 14.71, "max": 31.24},
        "failures": {"missed": 7, "jammed": 5, "over-force": 1},
        "duration_s": {"median": 3.123, "p95": 5.871},
        "without_force_success_rate": 0.085,
        "without_force_success_interval": [0.054, 0.132],
        "zeroed_force_success_rate": 0.155,
        "zeroed_force_success_interval": [0.111, 0.211],
        "blind_spiral_success_rate": 0.41,
        "blind_spiral_success_interval": [0.344, 0.479],
        "demonstrations": {
            "success_rate": 0.993,
            "peak_force_n": {"median": 8.74, "p95": 9.42},
            "duration_s": {"median": 2.812},
        },
        "seconds": {"collect": 48.25, "process": 31.05, "train": 171.44},
        "seed": 7,
        "versions": {"wrenchflow": "0.1.0", "numpy": "2.2.6"},
    }


@pytest.fixture
def clean(recording) -> Episode:
    return process_episode(recording(), ProcessConfig())[0]


@pytest.fixture
def failed(clean) -> Episode:
    return clean.with_meta(result={"success": False, "failure": "jammed", "duration_s": 8.0})


MADE: dict[str, str] = {}  # Drawing takes most of the time of these tests, so each page is made once.


@pytest.fixture
def make_page(clean, failed, recording):
    def make(summary: dict) -> str:
        key = json.dumps(summary)
        if key not in MADE:
            MADE[key] = draw(summary)
        return MADE[key]

    def draw(summary: dict) -> str:
        demonstrations = [(clean, "clean/0007.mcap"), (recording(force_only=True), "clean/0008.mcap")]
        rollouts = [(clean, "rollouts/a.mcap"), (clean, "rollouts/b.mcap"), (failed, "rollouts/c.mcap")]
        return quickstart_page(summary, demonstrations, rollouts, LINKS)

    make.again = draw
    return make


def test_the_page_is_well_formed_and_needs_no_network(make_page, summary):
    html = make_page(summary)
    assert_needs_no_network(html)
    document = read(html)
    ids = [attrs["id"] for _, attrs in document.tags if "id" in attrs]
    assert len(set(ids)) == len(ids) == len(document.figures) == 5
    assert html.count("plotly.js v") == 1


@pytest.mark.parametrize(
    "piece",
    [
        '<img alt="" src="x.png">',
        '<script src="https://a.example/x.js"></script>',
        '<a href="https://a.example">a</a>',
        '<link rel="stylesheet" href="x.css">',
        "<style>@import 'x.css';</style>",
        "<p>not closed",
    ],
)
def test_the_check_of_pages_fails_on_a_planted_fault(make_page, summary, piece):
    html = make_page(summary)
    with pytest.raises(AssertionError):
        assert_needs_no_network(html.replace("</main>", f"{piece}</main>"))


def test_every_figure_of_the_summary_is_said(make_page, summary):
    said = read(make_page(summary)).said
    expected = (
        "peg-insertion|301|1,167,342 samples|93.5 %|89.2 to 96.2 %|187 of 200|9.8 N|14.7 N|31.2 N|7 missed|5 jammed|"
        "1 over-force|3.12 s|5.87 s|8.5 %|5.4 to 13.2 %|15.5 %|11.1 to 21.1 %|41.0 %|34.4 to 47.9 %|99.3 %|8.7 N|9.4 N|"
        "2.81 s|collect 48.2 s|process 31.1 s|train 171.4 s|together 250.7 s|seed 7|wrenchflow 0.1.0|numpy 2.2.6|25 N"
    )
    assert [figure for figure in expected.split("|") if figure not in said] == []


def test_the_bars_are_as_long_as_the_rates(make_page, summary):
    bars = [attrs for attrs in read(make_page(summary)).all("rect") if attrs["class"].startswith("fill")]
    assert [float(attrs["width"]) for attrs in bars[:4]] == [93.5, 15.5, 8.5, 41.0]
    ends = {(float(attrs["x1"]), float(attrs["x2"])) for attrs in read(make_page(summary)).all("line")}
    assert {(89.2, 96.2), (11.1, 21.1), (5.4, 13.2), (34.4, 47.9)} <= ends


def test_the_first_one_and_the_first_failure_are_open(make_page, summary):
    document = read(make_page(summary))
    assert ["open" in attrs for attrs in document.all("details")] == [True, False, True, False, True]
    assert "failure: jammed after 8.00 s" in document.said


def test_files_are_linked(make_page, summary):
    document = read(make_page(summary))
    paths = [attrs["href"] for attrs in document.all("a")]
    assert {"clean/0007.mcap", "rollouts/c.mcap", "raw/", "dataset/robomimic.hdf5"} <= set(paths)
    assert "wrenchflow info clean/0007.mcap" in document.said


def test_optional_parts_are_plots_of_their_own(make_page, summary):
    plain = read(make_page(summary))
    full = read(
        make_page(
            summary
            | {"training": {"steps": [1, 2, 3], "loss": [1.0, 0.5, 0.2], "validation_loss": [1.1, None, 0.3]}}
            | {"peak_forces_n": [5.0, 9.0, 31.0], "force_limit_n": 30.0}
        )
    )
    assert len(full.figures) == len(plain.figures) + 2
    assert "limit 30 N" in full.said
    assert "Training" in full.said
    assert "Training" not in plain.said


def test_a_page_without_episodes_and_links_stands(summary):
    html = quickstart_page(summary, [], [], [])
    assert_needs_no_network(html)
    assert read(html).figures == []


def test_the_same_input_gives_the_same_bytes(make_page, summary):
    assert make_page.again(summary) == make_page(summary)


def test_text_from_outside_is_only_text(summary, clean):
    evil = "</script><script>alert(1)</script><b a='\">"
    episode = Episode(evil, evil, clean.streams, (Event(*clean.span_ns, "phase", evil),))
    failing = episode.with_meta(result={"success": False, "failure": evil, "duration_s": 1.0})
    summary |= {"task": evil, "failures": {evil: 1}, "seconds": {evil: 1.0}, "versions": {evil: evil}}
    html = quickstart_page(summary, [(episode, evil)], [(failing, evil)], [(evil, evil), ("x", "javascript:alert(1)")])
    assert_needs_no_network(html)
    document = read(html)
    assert len(document.all("script")) == 2 + len(document.figures)
    assert document.all("b") == [{}] * len(document.all("b"))
    assert document.said.count("alert(1)") > 8
    assert all("alert" not in key for _, attrs in document.tags for key in attrs)


def test_no_text_of_a_figure_ends_its_script():
    figure = training_figure({"steps": [1, 2], "loss": [0.2, 0.1]})
    figure.layout["title"] = {"text": "</script><!-- <script>"}
    (read_back,) = read(plot_block(figure, "a")).figures
    assert read_back["layout"]["title"]["text"] == "</script><!-- <script>"


def test_many_long_episodes_still_make_a_small_page(summary, recording):
    episode = process_episode(recording(samples=9000), ProcessConfig())[0]
    html = quickstart_page(summary, [(episode, "a")] * 10, [(episode, "b")] * 10, [])
    assert len(html) < 8e6


@pytest.mark.parametrize("failures", [0, 2, 5])
def test_evaluation_takes_what_deploy_sums_up(failed, failures):
    verdicts = [
        Verdict(
            id=f"{k}",
            success=k >= failures,
            failure="" if k >= failures else "missed",
            duration_s=3.5,
            peak_force_n=9.0,
        )
        for k in range(5)
    ]
    html = evaluation_page({"task": "peg-insertion"} | summarise(verdicts), [(failed, "a.mcap")], LINKS)
    assert_needs_no_network(html)
    said = read(html).said
    assert f"{5 - failures} of 5 attempts" in said
    assert (f"{failures} missed" in said) == (failures > 0)
    assert ("3.50 s" in said) == (failures < 5)
    assert "sees the wrench" not in said


def test_a_peak_at_the_limit_is_under_it():
    under, over = peak_force_figure([9.5, 25.0, 25.1, 26.0, 40.0], 25.0).data
    assert (list(under["x"]), list(under["y"])) == ([9.5, 24.5], [1, 1])
    assert (list(over["x"]), list(over["y"])) == ([25.5, 39.5], [2, 1])


def test_training_without_validation_is_one_line():
    assert [line["name"] for line in training_figure({"steps": [1, 2], "loss": [0.2, 0.1]}).data] == ["training"]
