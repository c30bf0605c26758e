"""How large the report of many episodes is, how long it takes to make, and to open in a headless Chromium.

    python benchmarks/report_page.py --episodes 200

Six demonstrations are processed, two a task, and stand in for all episodes with figures that vary by some per cent;
every tenth has a planted fault. A browser is started anew for each run, so nothing of the page is in its caches.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from browsing.headless import open_browser
from force import planted
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import demonstrate
from wrenchflow.episode import Episode
from wrenchflow.process.assessment import Assessment
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.data_set import look_at_all
from wrenchflow.process.pipeline import look_at
from wrenchflow.process.report.episode_page import LIBRARY, episode_page, library_script
from wrenchflow.process.report.folder_page import folder_page

TASKS = ("peg-insertion", "surface-wiping", "connector-insertion")
FAULTS = (planted.spike, planted.dropout, planted.stuck, planted.vibration, planted.wrong_sign)
RUNS, PAGE_RUNS = 5, 40
_PLOTS = "document.querySelectorAll('.plot').length"
_DRAWN = f"document.querySelectorAll('.js-plotly-plot').length === {_PLOTS}"


def main() -> int:
    """Measure and print; 1 if a page is not as it should be."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--out", type=Path, help="folder that keeps the pages")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.out or Path(scratch)
        return measure(folder, arguments.episodes)


def measure(folder: Path, count: int) -> int:
    """Make the pages in a folder, and open them."""
    config, rng = ProcessConfig(), np.random.default_rng(0)
    clean = [demonstrate(k, CollectConfig(task=task, operator="emulated", seed=3)) for task in TASKS for k in range(2)]
    raws = [*clean, *(plant(clean[k % len(clean)], rng) for k, plant in enumerate(FAULTS))]
    looked = [look_at(raw, config) for raw in raws]
    sound, faulty = ([each for _, each in part] for part in (looked[: len(clean)], looked[len(clean) :]))
    assessments = [varied(faulty if k % 10 == 9 else sound, k, rng) for k in range(count)]
    pages = [f"episodes/{each.id}.html" for each in assessments]
    (folder / "episodes").mkdir(parents=True, exist_ok=True)
    begun = time.perf_counter()
    html = folder_page(look_at_all(assessments), config, pages=pages)
    print(
        f"{count} episodes: page made in {time.perf_counter() - begun:.2f} s, {len(html.encode()) / 1e6:.1f} MB", end=""
    )
    (folder / "report.html").write_text(html, encoding="utf-8")
    (folder / "episodes" / LIBRARY).write_text(library_script(), encoding="utf-8")
    cost_ms, one = timed_page(raws[0], looked[0], config)
    print(f"; a page an episode {cost_ms:.1f} ms of processor time, {len(one) / 1e3:.0f} kB")
    (folder / pages[0]).write_text(one, encoding="utf-8")
    said = [*opened(folder / "report.html"), *opened(folder / pages[0])]
    print("errors in the console, and requests of a network: " + ("; ".join(said) or "none"))
    return 1 if said else 0


def varied(of: Sequence[Assessment], number: int, rng: np.random.Generator) -> Assessment:
    """One of some assessments, as if of another episode."""
    chosen = of[number % len(of)]
    values = {
        name: value * rng.lognormal(0.0, 0.08) if isinstance(value, float) else value
        for name, value in chosen.values.items()
    }
    curve = tuple(rng.lognormal(0.0, 0.05) * np.array(chosen.curve))
    return replace(chosen, id=f"{chosen.task}-{number:04d}", values=values, curve=curve)


def timed_page(raw: Episode, looked: tuple[Episode | None, Assessment], config: ProcessConfig) -> tuple[float, str]:
    """Processor time that the page of an episode costs, the median of some [ms]; and the page."""
    spent_ms = []
    for _ in range(PAGE_RUNS):
        begun = time.process_time()
        page = episode_page(looked[1], raw, looked[0], config, previous="a.html", following="b.html")
        spent_ms.append(1e3 * (time.process_time() - begun))
    return float(np.median(spent_ms)), page


def opened(page: Path) -> list[str]:
    """Open a page in new browsers and print how long that takes; what its console says, and what it asks a network."""
    load_s, drawn_s, said = [], [], []
    for _ in range(RUNS):
        with open_browser() as tab:
            begun = time.perf_counter()
            load_s.append(tab.open(page.resolve().as_uri()))
            tab.wait_for(_DRAWN)
            drawn_s.append(time.perf_counter() - begun)
            said += [*tab.said, *tab.asked]
    for what, seconds in (("until it is loaded", load_s), ("until all plots stand", drawn_s)):
        spread = f"{np.median(seconds):.2f} s, median of {RUNS} ({min(seconds):.2f} to {max(seconds):.2f})"
        print(f"{page.name}, {what}: {spread}")
    return said


if __name__ == "__main__":
    sys.exit(main())
