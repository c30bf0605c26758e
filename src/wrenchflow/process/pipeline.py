"""The stage `process`: raw recordings to clean ones, with what their force is worth beside them."""

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from wrenchflow.config import to_mapping
from wrenchflow.episode import Episode, Event
from wrenchflow.episodes_map import map_episodes
from wrenchflow.errors import ConfigError, WrenchflowError
from wrenchflow.manifest import output_folder, write_manifest
from wrenchflow.process.anomalies.mask import ANOMALY, mask_of
from wrenchflow.process.assess import assess, unreadable
from wrenchflow.process.assessment import Assessment
from wrenchflow.process.clean import Cleaned, clean_episode
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.data_set import look_at_all
from wrenchflow.process.report.episode_page import LIBRARY, episode_page, library_script
from wrenchflow.process.report.folder_page import folder_page
from wrenchflow.process.table import write_tables
from wrenchflow.recording.reader import find_recordings, read_episode
from wrenchflow.recording.write import write_episode
from wrenchflow.rig import rig_of

REPORT, EPISODES = "report.html", "episodes"


def process_episode(episode: Episode, config: ProcessConfig) -> tuple[Episode, Assessment]:
    """Clean the force of one episode, and assess it.

    Args:
        episode: See `clean_episode`.
        config: How.

    Returns:
        The episode with `wrench`, `wrench_zero_phase`, its contacts, what is wrong with it as events of the kind
        `anomaly`, and `meta["process"]` added; and what is known of it.

    Raises:
        WrenchflowError: If it cannot be cleaned. `look_at` says so in the assessment instead.
    """
    cleaned = clean_episode(episode, config)
    return _with_findings(cleaned, assessment := assess(episode, cleaned, config)), assessment


def look_at(episode: Episode, config: ProcessConfig) -> tuple[Episode | None, Assessment]:
    """Clean and assess one episode, whatever is wrong with it.

    Args:
        episode: Any; what it lacks is a finding, and what rests on that is not assessed.
        config: How.

    Returns:
        The clean episode, None where it cannot be cleaned; and what is known of it.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):  # What comes to no number is not assessed.
        cleaned = _try_to_clean(episode, config)
        assessment = assess(episode, cleaned, config)
    return (None if isinstance(cleaned, WrenchflowError) else _with_findings(cleaned, assessment)), assessment


def process_folder(
    raw: Path,
    out: Path,
    config: ProcessConfig,
    *,
    jobs: int = 1,
    overwrite: bool = False,
    executor: Executor | None = None,
) -> Iterator[Assessment]:
    """Clean and assess every recording of a folder.

    A recording that cannot be cleaned, or not even read, is in the report with the reason, and not among the clean
    ones.

    Args:
        raw: Folder of `*.mcap`; it is only read.
        out: Folder that gets the clean recordings, `quality.parquet`, `quality.json`, `report.html` and
            `manifest.json`, and a page an episode in `episodes/`. It is complete once the iterator is exhausted, and
            does not exist before.
        config: How.
        jobs: Worker processes.
        overwrite: Replace `out` if it is there.
        executor: Used in place of worker processes of its own.

    Yields:
        What is known of each episode, in the order of the names.

    Raises:
        RecordingError: If there is nothing to read.
        OutputError: If `out` is taken, or holds `raw`.
        ConfigError: If the configuration fits no recording.
    """
    paths = [path.resolve() for path in find_recordings(raw)]  # A worker on a cluster runs in another folder.
    names = [path.name.removesuffix(".mcap") for path in paths]
    around = list(zip(paths, ["", *names[:-1]], [*names[1:], ""], strict=True))
    with output_folder(out, overwrite=overwrite, reads=[raw]) as folder:
        (folder / EPISODES).mkdir()
        (folder / EPISODES / LIBRARY).write_text(library_script(), encoding="utf-8")
        assessments = []
        for assessment in map_episodes(partial(_process_file, folder, config), around, jobs=jobs, executor=executor):
            assessments.append(assessment)
            yield assessment
        quality = look_at_all(assessments)
        write_tables(folder, quality)
        pages = [f"{EPISODES}/{name}.html" for name in names]
        (folder / REPORT).write_text(folder_page(quality, config, pages=pages), encoding="utf-8")
        write_manifest(folder, "process", config, paths)


def _try_to_clean(episode: Episode, config: ProcessConfig) -> Cleaned | WrenchflowError:
    try:
        rig_of(episode.meta, "its metadata")
    except ConfigError as error:
        return error
    try:
        return clean_episode(episode, config)
    except ConfigError:
        raise  # The recording has a rig, so it is the configuration that is wrong, and for every other one too.
    except WrenchflowError as error:
        return error


def _process_file(folder: Path, config: ProcessConfig, around: tuple[Path, str, str]) -> Assessment:
    """Work off one file; with it come the names of those before and after it."""
    path, before, after = around
    episode, clean = None, None
    try:
        episode = read_episode(path)
    except WrenchflowError as error:
        assessment = unreadable(path.stem, error)
    else:
        clean, assessment = look_at(episode, config)
    if clean is not None:
        write_episode(folder / path.name, clean)
    previous, following = (f"{name}.html" if name else "" for name in (before, after))
    text = episode_page(assessment, episode, clean, config, previous=previous, following=following)
    (folder / EPISODES / f"{path.stem}.html").write_text(text, encoding="utf-8")
    return assessment


def _with_findings(cleaned: Cleaned, assessment: Assessment) -> Episode:
    others = tuple(event for event in cleaned.episode.events if event.kind != ANOMALY)
    found = tuple(Event(each.start_ns, each.stop_ns, ANOMALY, each.kind) for each in assessment.findings)
    notes = cleaned.episode.meta["process"] | {"findings": to_mapping(assessment.findings)}
    marked = replace(cleaned.episode, events=others + found).with_meta(process=notes)
    mask = mask_of(marked["wrench_raw"], assessment.findings)
    return marked if mask is None else marked.with_stream(ANOMALY, mask)
