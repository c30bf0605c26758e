"""Writes the pages of finished stages from their files; beside the command line, imported by nothing but it."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from wrenchflow.deploy.evaluation import Verdict, summarise
from wrenchflow.episode import Episode
from wrenchflow.pages.evaluation import evaluation_page
from wrenchflow.pages.quickstart import quickstart_page
from wrenchflow.process.clean import clean_episode
from wrenchflow.process.config import ProcessConfig
from wrenchflow.recording.reader import read_episode

_SHOWN = 3  # Demonstrations, and successful rollouts, on a page.


def write_quickstart_page(out: Path, summary: dict[str, Any], verdicts: Sequence[Verdict]) -> None:
    """Write `index.html` into the folder that `quickstart` fills."""
    paths = sorted((out / "clean").glob("*.mcap"))[:_SHOWN]
    demonstrations = [(read_episode(path), f"clean/{path.name}") for path in paths]
    links = [
        ("Raw recordings", "raw/"),
        ("Clean recordings", "clean/"),
        ("Quality report", "clean/report.html"),
        ("robomimic data set", "dataset/robomimic.hdf5"),
        ("LeRobot data set", "dataset/lerobot/"),
        ("Trained policy", "run/"),
        ("Rollouts", "rollouts/"),
        ("Evaluation", "rollouts/evaluation.html"),
    ]
    rollouts = _rollouts(out / "rollouts", verdicts, "rollouts/")
    _write(out / "index.html", quickstart_page(summary, demonstrations, rollouts, links))


def write_evaluation_page(out: Path, task: str, verdicts: Sequence[Verdict], force_limit_n: float) -> None:
    """Write `evaluation.html` into the folder that `deploy` fills."""
    peaks_n = [verdict.peak_force_n for verdict in verdicts]
    summary = {"task": task, "peak_forces_n": peaks_n, "force_limit_n": force_limit_n} | summarise(verdicts)
    links = [("Figures", "evaluation.json"), ("What was run", "manifest.json")]
    _write(out / "evaluation.html", evaluation_page(summary, _rollouts(out, verdicts, ""), links))


def _rollouts(folder: Path, verdicts: Sequence[Verdict], prefix: str) -> list[tuple[Episode, str]]:
    """The first successes and the first failure, with their force cleaned, and where their files are."""
    wanted = [verdict.id for verdict in verdicts if verdict.success][:_SHOWN]
    wanted += [verdict.id for verdict in verdicts if not verdict.success][:1]
    config = ProcessConfig()
    episodes = [clean_episode(read_episode(folder / f"{name}.mcap"), config).episode for name in wanted]
    return [(episode, f"{prefix}{episode.id}.mcap") for episode in episodes]


def _write(path: Path, text: str) -> None:
    partial = path.with_name(path.name + ".partial")
    partial.write_text(text, encoding="utf-8")
    os.replace(partial, path)
