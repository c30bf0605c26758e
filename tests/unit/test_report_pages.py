"""The pages of the report: all that was found and all that could not be told is said, as text and nothing else."""

import base64
import importlib
import pkgutil
import re
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from plotly.graph_objects import Figure

from browsing.document import Document, assert_needs_no_network, read
from browsing.headless import CHROMIUM, open_browser
from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import RecordingError
from wrenchflow.pages.drawing import Drawing
from wrenchflow.pages.episode_plot import episode_figure
from wrenchflow.process import anomalies, assess
from wrenchflow.process.anomalies.mask import ANOMALY
from wrenchflow.process.assess import unreadable
from wrenchflow.process.assessment import Assessment, PhaseQuality, StreamTiming
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.data_set import DataSetQuality, look_at_all
from wrenchflow.process.finding import Finding, NotAssessed
from wrenchflow.process.metric import METRICS
from wrenchflow.process.pipeline import look_at
from wrenchflow.process.report.episode_page import LIBRARY, episode_page, library_script
from wrenchflow.process.report.folder_page import folder_page
from wrenchflow.process.report.shown import Shown
from wrenchflow.process.report.spectrum import amplitude_density, spectrum_figure
from wrenchflow.process.report.spread_plots import coverage_figure, curves_figure
from wrenchflow.process.report.words import ADVICE

CONFIG = ProcessConfig()
EVIL = "</script><img src=x onerror=alert(1)><b a='\">"
_RNG = np.random.default_rng(0)
_VALUES = MappingProxyType({metric.name: metric.type(3) for metric in METRICS})


def finding(kind: str, severity: str, *, at_ms: int = 100, evidence: str = "") -> Finding:
    start_ns = at_ms * 1_000_000
    text = evidence or f"evidence of {kind} at {at_ms}"
    return Finding(
        kind=kind, severity=severity, start_ns=start_ns, stop_ns=start_ns + 10**7, columns=("fx",), evidence=text
    )


def assessment(number: int, *findings: Finding, **others) -> Assessment:
    values = {
        name: value * (1.0 + 0.1 * number) if isinstance(value, float) else value for name, value in _VALUES.items()
    }
    lacking = NotAssessed(kind="energy_gap", reason=f"{number} J were exchanged, 100 needed")
    curve = tuple(np.sin(np.linspace(0.0, 3.0, 100)) * (1.0 + 0.01 * number))
    timing = StreamTiming(
        name="wrench_raw",
        samples=3,
        rate_hz=1000.0,
        period_s=0.001,
        jitter_s=1e-5,
        gaps=number % 2,
        longest_s=0.004,
        repeated=0.0,
        steps_ms=(1.0, 2.0, 4.0),
        counts=(number, 1),
    )
    made = Assessment(
        id=f"episode-{number:04d}",
        task="push",
        success=(True, False, None)[number % 3],
        values=values | {"energy_gap": None},
        findings=findings,
        not_assessed=(lacking,),
        streams=(timing,),
        curve=curve,
        contact_start_m=(0.001 * number, 0.0, 0.0),
    )
    return replace(made, **others)


def folder(count: int = 12) -> DataSetQuality:
    """Twelve episodes: many spikes in one, saturation in four, one unreadable, one with a force beyond all others."""
    made = [assessment(number) for number in range(count)]
    spikes = [finding("spike", "warning", at_ms=100 * k) for k in range(1, 9)]
    made[1] = assessment(1, *spikes)
    for number in (2, 3, 4, 5):
        made[number] = assessment(number, finding("saturation", "defect", at_ms=number))
    made[6] = assessment(6, finding("never-heard-of", "note"))
    made[7] = unreadable("broken", RecordingError("it ends in the middle"))
    made[8] = assessment(8, values=assessment(8).values | {"max_force": 1e4})
    return look_at_all(made)


@pytest.fixture(scope="module")
def html() -> str:
    quality = folder()
    return folder_page(quality, CONFIG, pages=[f"episodes/{each.id}.html" for each in quality.assessments])


def rows_of(html: str, table: str) -> list[str]:
    body = html.partition(f'id="{table}"')[2].partition("<tbody>")[2].partition("</tbody>")[0]
    return re.findall(r"<tr.*?</tr>", body, re.S)


def assert_says_no_nonsense(document: Document) -> None:
    """No value that is none: neither in words nor as an empty cell."""
    assert not re.search(r"\b(nan|inf|None|null)\b", document.said)
    assert not re.search(r"<td[^>]*>\s*</td>", document.html.partition("<main>")[2].partition("<script")[0])


def test_the_page_is_whole_and_needs_no_network(html):
    assert_needs_no_network(html)
    document = read(html)
    ids = [attrs["id"] for _, attrs in document.tags if "id" in attrs]
    assert len(set(ids)) == len(ids)
    assert html.count("plotly.js v") == 1
    assert_says_no_nonsense(document)


def test_every_finding_is_told_with_what_to_do(html):
    said = read(html).said
    for each in folder().assessments:
        kinds = {finding.kind for finding in each.findings}
        for kind in kinds:
            told = [finding.evidence in said for finding in each.findings if finding.kind == kind]
            assert all(told) or (told[:3] == [True] * 3 and f"and {len(told) - 3} more of this kind" in said)
    assert ADVICE["saturation"] in said
    assert "never heard of" in said
    assert said.index("evidence of saturation at 2") < said.index("evidence of spike at 100")


def test_all_that_was_not_assessed_is_told_with_its_reason(html):
    said = read(html).said
    for each in folder().assessments:
        for lacking in each.not_assessed:
            assert lacking.reason in said
    assert "energy gap" in said
    quality = replace(folder(), not_assessed=(NotAssessed(kind="spread", reason="there is but one"),))
    assert "spread: there is but one" in read(folder_page(quality, CONFIG)).said


def test_every_episode_has_one_row_and_a_link_to_its_page(html):
    rows = rows_of(html, "episodes")
    assert len(rows) == 12
    for each, row in zip(folder().assessments, rows, strict=True):
        assert f'href="episodes/{each.id}.html"' in row
        assert row.count(each.id) == 2
    head = html.partition('id="episodes"')[2].partition("</thead>")[0].count("<th ")
    assert {len(re.findall("<td", row)) for row in rows} == {head}


def test_every_episode_is_a_dot_in_every_distribution_it_has_a_value_in(html):
    quality = folder()
    dots = re.findall(r'data-e="(\d+)" aria-label="([^"]*)"', html)
    assert len(dots) == sum(of.count for of in quality.distributions.values())
    assert all(label.startswith(quality.assessments[int(number)].id) for number, label in dots)
    assert html.count('<use href="#dot-defect"') == sum(
        each[name] is not None for each in quality.assessments if not each.is_sound for name in quality.distributions
    )


def test_without_pages_nothing_is_linked():
    document = read(folder_page(folder(), CONFIG))
    assert all(attrs["href"].startswith("#") for attrs in document.all("a"))


def test_as_many_pages_as_episodes_are_needed():
    with pytest.raises(ValueError, match="got 1 for 12"):
        folder_page(folder(), CONFIG, pages=["a.html"])


def test_the_meaning_of_every_figure_and_every_setting_is_told(html):
    said = read(html).said
    for metric in METRICS:
        assert metric.meaning.replace("`", " ").split() == [
            word for word in metric.meaning.replace("`", " ").split() if word in said
        ]
    assert "filter.cutoff_hz" in said
    assert f"{CONFIG.filter.cutoff_hz:g}" in said


def test_the_same_quality_gives_the_same_bytes(html):
    pages = [f"episodes/{each.id}.html" for each in folder().assessments]
    assert folder_page(folder(), CONFIG, pages=pages) == html


@pytest.mark.parametrize("count", [0, 1])
def test_few_episodes_still_make_a_page(count):
    document = read(folder_page(look_at_all([assessment(k) for k in range(count)]), CONFIG))
    assert_says_no_nonsense(document)
    assert len(rows_of(document.html, "episodes")) == count


def hostile() -> Assessment:
    timing = replace(assessment(1).streams[0], name=EVIL)
    bad = finding(EVIL, "defect", evidence=EVIL)
    return assessment(
        1,
        replace(bad, columns=(EVIL,)),
        id=EVIL,
        task=EVIL,
        refused=EVIL,
        not_assessed=(NotAssessed(kind=EVIL, reason=EVIL),),
        streams=(timing,),
        notes=(EVIL,),
        phases=(PhaseQuality(label=EVIL, start_s=0.0, stop_s=1.0, values={"sparc": None}, why={"sparc": EVIL}),),
    )


def assert_only_text(html: str, *, library: str = "") -> None:
    assert_needs_no_network(html, library=library)
    document = read(html)
    # The plotting library, what draws, what else the page runs, and plots.
    others = [each for each in document.all("script") if each.get("type") != "application/json"]
    assert len(others) == (2 if library else 3)
    assert not document.all("b") or all(set(attrs) <= {"class"} for attrs in document.all("b"))
    assert all("onerror" not in key for _, attrs in document.tags for key in attrs)
    assert document.said.count("alert(1)") > 8


def test_text_from_outside_is_only_text():
    strange = replace(hostile(), values=assessment(1).values | {"max_force": 1e5})
    quality = look_at_all([strange, *(replace(assessment(k), task=EVIL) for k in range(12))])
    assert_only_text(folder_page(quality, CONFIG, pages=[f"episodes/{EVIL}.html"] * 13))


def test_text_from_outside_is_only_text_on_the_page_of_an_episode(recording):
    clean, _ = look_at(recording(), CONFIG)
    assert clean is not None
    named = replace(clean, id=EVIL, task=EVIL, events=(*clean.events, Event(*clean.span_ns, "phase", EVIL)))
    html = episode_page(hostile(), named, named, CONFIG, previous=EVIL, following="javascript:alert(1)", report=EVIL)
    assert_only_text(html, library=LIBRARY)


def test_bytes_that_are_no_text_do_no_harm():
    name = "caf\udce9"  # As Python hands over a file name that is not UTF-8.
    quality = look_at_all([assessment(0, id=name)])
    html = folder_page(quality, CONFIG, pages=[f"{name}.html"])
    assert 'href="caf%E9.html"' in html
    assert html.encode()


def test_the_page_of_an_episode_tells_all_of_it(recording):
    raw = recording().with_meta(**{"import": {"notes": ["Stamps came in milliseconds."]}})
    clean, known = look_at(raw, CONFIG)
    mark = finding("spike", "warning", at_ms=6200)
    known = replace(known, findings=(*known.findings, mark))
    html = episode_page(known, raw, clean, CONFIG, previous="a.html", following="c.html")
    assert_needs_no_network(html, library=LIBRARY)
    document = read(html)
    assert_says_no_nonsense(document)
    for each in known.findings:
        assert each.evidence in document.said
        assert ADVICE[each.kind] in document.said
    for lacking in known.not_assessed:
        assert lacking.reason in document.said
    assert all(metric.title in document.said for metric in METRICS)
    assert all(phase.label in document.said for phase in known.phases)
    assert "Stamps came in milliseconds." in document.said
    assert {"a.html", "c.html", "../report.html"} <= {attrs["href"] for attrs in document.all("a")}
    assert html == episode_page(known, raw, clean, CONFIG, previous="a.html", following="c.html")
    # The place of a finding, in the time of the plot: from the end of the tare.
    (place,) = [attrs for attrs in document.all("a") if "data-from" in attrs]
    assert float(place["data-from"]) < 0.7 < 0.71 < float(place["data-to"])
    assert len(html) < 0.5e6
    assert library_script().startswith("/**")


def test_a_recording_without_a_clean_force_is_drawn_as_it_is(recording):
    raw = recording()
    raw = replace(raw, meta={name: value for name, value in raw.meta.items() if name != "rig"})
    clean, known = look_at(raw, CONFIG)
    assert clean is None
    document = read(episode_page(known, raw, clean, CONFIG))
    assert known.refused in document.said
    names = {trace.get("name") for trace in document.figures[0]["data"]}
    assert {"fx", "fy", "fz"} <= names
    assert "Energy balance not assessed" in document.said
    assert document.figures[1]["data"][0]["name"] == "the whole recording"


def test_a_file_that_cannot_be_read_has_a_page():
    document = read(episode_page(unreadable("x", RecordingError("it ends early")), None, None, CONFIG))
    assert "it ends early" in document.said
    assert not document.figures
    assert_says_no_nonsense(document)


def spoilt(raw: Episode, how: str) -> Episode:
    stream = raw["wrench_raw"]
    data = stream.data.copy()
    if how == "nan":
        data[:] = np.nan
    elif how == "constant":
        data[:] = 1.0
    elif how == "huge":
        data[700:900] = 1e12
    elif how == "empty":
        return Episode("e", "push")
    count = 2 if how == "two" else len(data)
    return raw.with_stream("wrench_raw", Stream(stream.t[:count], data[:count], stream.signal, stream.frame))


@pytest.mark.parametrize("how", ["nan", "constant", "huge", "two", "empty"])
def test_bad_recordings_make_pages_that_say_so(recording, how):
    raw = spoilt(recording(), how)
    clean, known = look_at(raw, CONFIG)
    document = read(episode_page(known, raw, clean, CONFIG))
    assert_says_no_nonsense(document)
    assert "not assessed" in document.said
    assert_says_no_nonsense(read(folder_page(look_at_all([known]), CONFIG)))


def test_what_is_no_measurement_is_not_drawn(recording):
    raw = recording()
    data = raw["wrench_raw"].data.copy()
    data[700:900] = 1e300
    raw = raw.with_stream("wrench_raw", replace(raw["wrench_raw"], data=data))
    assert spectrum_figure(raw, None, 40.0) == (None, ["the reading exceeds 1e+30"])
    drawn = [trace["y"] for trace in episode_figure(raw, "").data if trace["type"] == "scatter"]
    assert not any(np.isinf(y).any() for y in drawn)
    assert any(np.isnan(y).any() for y in drawn)


def kinds() -> set[str]:
    """Every kind that a detector's module names in a constant."""
    found = {assess.REFUSED, assess.NO_CONTACT, assess.UNREADABLE}
    for each in pkgutil.iter_modules(anomalies.__path__):
        module = importlib.import_module(f"{anomalies.__name__}.{each.name}")
        texts = [value for name, value in vars(module).items() if name.isupper() and isinstance(value, str)]
        found |= {text for text in texts if re.fullmatch(r"[a-z]+(-[a-z]+)*", text)}
    return found - {ANOMALY}  # That is what an event is called which marks any of them.


def test_there_is_something_to_do_about_every_kind():
    assert {"spike", "wrong-payload", "no-contact"} <= kinds()
    assert kinds() - set(ADVICE) == set()


def test_plotly_takes_every_plot_and_names_what_is_unusual(recording):
    made = [assessment(k) for k in range(12)]
    made[3] = replace(made[3], curve=tuple(9.0 + np.zeros(100)))
    quality = look_at_all(made)
    shown = Shown(assessments=quality.assessments, pages=[f"{each.id}.html" for each in made])
    curves = curves_figure(quality, "push", shown)
    (named,) = [trace for trace in curves.data if trace["name"] == "episode-0003"]
    assert named["customdata"][0] == "episode-0003.html"
    places = coverage_figure(range(12), shown)
    assert sorted(x for trace in places.data for x in trace["x"]) == pytest.approx(range(12))
    spectrum, lacking = spectrum_figure(recording(), None, 40.0)
    assert spectrum is not None
    assert not lacking
    for drawing in (curves, places, spectrum):
        Figure(drawing.data, drawing.layout)


def test_a_spectrum_holds_the_power_of_what_it_is_of():
    t = np.arange(20_000) / 1000.0
    data = np.stack([3.0 * np.sin(2 * np.pi * 60.0 * t), _RNG.normal(size=len(t))], axis=1)
    rows = np.ones(len(t), bool)
    rows[5000:5010] = False
    density = amplitude_density(data, rows, 250, 1000.0)
    assert density is not None
    assert density.argmax() == 15  # In steps of 4 Hz.
    assert (density**2).sum() * 4.0 == pytest.approx(4.5 + 1.0, rel=0.03)
    assert amplitude_density(data, rows & (np.arange(len(t)) % 200 != 0), 250, 1000.0) is None


def test_what_a_drawing_holds_comes_back():
    values = np.array([1.0, np.nan, 3.0])
    drawing = Drawing(data=[{"x": values.astype(np.float32), "y": [1.0, np.inf], "z": "</script>\u2028&"}])
    text = drawing.to_json()
    assert "<" not in text
    assert "\u2028" not in text
    figure = Document(f"<script type='application/json'>{text}</script>").figures[0]
    assert figure["data"][0]["y"] == [1.0, None]
    assert figure["data"][0]["z"] == "</script>\u2028&"
    back = np.frombuffer(base64.b64decode(figure["data"][0]["x"]["bdata"]), "<f4")
    assert np.array_equal(back, values, equal_nan=True)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium here")
def test_a_browser_shows_it_without_an_error(tmp_path, recording):
    quality = folder()
    strange = replace(hostile(), id=EVIL)
    quality = look_at_all([strange, *quality.assessments])
    pages = [f"episodes/{number}.html" for number in range(13)]
    (tmp_path / "episodes").mkdir()
    (tmp_path / "report.html").write_text(folder_page(quality, CONFIG, pages=pages))
    raw = recording()
    clean, known = look_at(raw, CONFIG)
    known = replace(known, findings=(finding("spike", "warning", at_ms=6200),))
    (tmp_path / "episodes" / "0.html").write_text(episode_page(known, raw, clean, CONFIG, following="1.html"))
    drawn = "document.querySelectorAll('.js-plotly-plot').length"
    visible = "[...document.querySelectorAll('#episodes tbody tr')].filter(row => !row.hidden).length"
    with open_browser() as tab:
        tab.open(f"file://{tmp_path}/report.html")
        tab.wait_for(f"{drawn} === document.querySelectorAll('.plot').length && {drawn} > 1")
        tab.evaluate("document.querySelectorAll('#episodes th button')[6].click()")
        sorted_by = [
            float(value)
            for value in tab.evaluate(
                "[...document.querySelectorAll('#episodes td:nth-child(7)')].map(e => e.dataset.v)"
            )
            if value
        ]
        assert sorted_by == sorted(sorted_by)
        assert len(sorted_by) == 12
        tab.evaluate("search.value = 'saturation'; search.dispatchEvent(new Event('input'))")
        assert tab.evaluate(visible) == 4
        (tmp_path / "episodes" / LIBRARY).write_text(library_script())
        tab.open(tab.evaluate("document.querySelector('a[href=\"episodes/0.html\"]').href"))
        tab.wait_for(f"{drawn} === 2")
        tab.evaluate("document.querySelector('[data-from]').click()")
        tab.wait_for("document.getElementById('force').layout.xaxis.range[0] > 0.5")
        assert tab.evaluate("document.getElementById('force').layout.xaxis.range[1]") < 0.9
        assert tab.said == []
        assert tab.asked == []
        # A page that does not find the library says so.
        (tmp_path / "episodes" / LIBRARY).unlink()
        tab.open(f"file://{tmp_path}/episodes/0.html")
        tab.wait_for("document.body.textContent.includes('This plot is not drawn')")
