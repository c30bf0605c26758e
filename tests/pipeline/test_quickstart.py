"""`quickstart`, as small as it goes: every path and every figure that it promises."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest

STAGES = {"collect", "process", "export", "train", "deploy", "compare", "page"}
ARMS = ("", "without_force_", "zeroed_force_", "blind_spiral_")
TINY = ("--episodes", 4, "--train-steps", 50, "--rollouts", 2, "--seed", 2, "--jobs", 1)


@pytest.fixture(scope="module")
def quickstart(wrenchflow, tmp_path_factory):
    out = tmp_path_factory.mktemp("quickstart") / "out"
    return out, wrenchflow("quickstart", out, *TINY, "--json")


def test_it_leaves_what_it_promises(quickstart):
    out, ran = quickstart
    assert ran.code == 0
    for path in ("dataset/robomimic.hdf5", "index.html", "clean/report.html", "clean/quality.parquet"):
        assert (out / path).is_file(), path
    for folder, recordings in (("raw", 4), ("clean", 4), ("rollouts", 2)):
        assert len(list((out / folder).glob("*.mcap"))) == recordings
        assert json.loads((out / folder / "manifest.json").read_text())["versions"]["wrenchflow"]
    for folder in ("dataset/lerobot", "run", "run_without_force"):
        assert (out / folder).is_dir(), folder
    assert list(out.rglob("*.partial")) == []


def test_it_prints_one_object_with_the_figures_and_nothing_else(quickstart):
    out, ran = quickstart
    said = json.loads(ran.stdout)
    assert (ran.stdout.count("\n"), ran.stderr) == (1, "")
    assert (said["episodes"], said["rollouts"], said["seed"]) == (4, 2, 2)
    assert said["samples"] > 4 * 2000
    for arm in ARMS:
        rate, (low, high) = said[f"{arm}success_rate"], said[f"{arm}success_interval"]
        assert 0.0 <= low <= rate <= high <= 1.0
        assert rate in (0.0, 0.5, 1.0)
        peak = said[f"{arm}peak_force_n"]
        assert 0.0 < peak["median"] <= peak["p95"] <= peak["max"] < 100.0
    assert set(said["seconds"]) >= STAGES
    assert all(value >= 0.0 for value in said["seconds"].values())
    assert said["page"] == str(out / "index.html")


def test_its_figures_are_those_of_the_rollouts(quickstart):
    out, ran = quickstart
    said, evaluation = json.loads(ran.stdout), json.loads((out / "rollouts" / "evaluation.json").read_text())
    for key in ("successes", "success_rate", "success_interval", "peak_force_n", "failures"):
        assert said[key] == evaluation[key]
    assert [attempt["id"] for attempt in evaluation["attempts_by_id"]] == [
        path.stem for path in sorted((out / "rollouts").glob("*.mcap"))
    ]


class _Links(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value for name, value in attrs if name in ("href", "src") and value]


def test_its_page_needs_no_network_and_its_links_lead_somewhere(quickstart):
    out: Path = quickstart[0]
    links = _Links()
    links.feed((out / "index.html").read_text())
    assert links.found
    for link in links.found:
        assert not re.match(r"(?i)(https?:)?//", link), link
        if not link.startswith(("#", "data:")):
            assert (out / link).exists(), link


@pytest.mark.slow
def test_it_keeps_what_is_there_unless_told(quickstart, wrenchflow):
    out, first = quickstart
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*")}
    ran = wrenchflow("quickstart", out, *TINY)
    assert ran.code == 1
    assert re.fullmatch(r"wrenchflow: output '.*' holds raw, .*, index\.html already\. .*\n", ran.stderr)
    assert {path: path.stat().st_mtime_ns for path in out.rglob("*")} == before
    # Again, and told so: the same figures but for the times, this time as a table.
    again = wrenchflow("quickstart", out, *TINY, "--overwrite")
    assert (again.code, again.stderr) == (0, "")
    said = json.loads(first.stdout)
    assert f"{said['episodes']} episodes, {said['samples']:,} samples" in again.stdout
    for label in ("policy, with force", "force zeroed", "without force", "blind spiral"):
        assert re.search(rf"{label} +[\d.]+% +\[[\d.]+%, [\d.]+%\] +[\d.]+ / [\d.]+ N", again.stdout), label
    assert re.search(r"seconds +collect \d", again.stdout)


def test_replacing_stops_before_anything_that_is_not_ours_and_an_old_page_never_stands_beside_new_data(
    wrenchflow, tmp_path, monkeypatch
):
    from wrenchflow import quickstart

    out = tmp_path / "out"
    for name in ("raw", "clean", "run"):
        (out / name).mkdir(parents=True)
        (out / name / "manifest.json").write_text("{}")
    (out / "dataset").mkdir()
    (out / "dataset" / "robomimic.hdf5.partial").write_text("an export was interrupted")
    (out / "index.html").write_text("of the old run")
    (out / "rollouts").mkdir()
    (out / "rollouts" / "thesis.txt").write_text("precious")
    ran = wrenchflow("quickstart", out, *TINY, "--overwrite")
    assert ran.code == 1
    assert "is no folder that wrenchflow made" in ran.stderr
    assert (out / "index.html").exists()
    (out / "rollouts" / "thesis.txt").unlink()
    (out / "rollouts").rmdir()

    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(quickstart, "collect_folder", interrupted)
    assert wrenchflow("quickstart", out, *TINY, "--overwrite").code == 130
    assert list(out.iterdir()) == []
