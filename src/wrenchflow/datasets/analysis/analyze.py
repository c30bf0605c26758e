"""The stage `analyze`: any data set, streamed, to a page and to tables."""

from collections.abc import Iterator
from concurrent.futures import Executor
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa

from wrenchflow.datasets.analysis.analysis import Analysis
from wrenchflow.datasets.analysis.config import AnalysisConfig
from wrenchflow.datasets.analysis.figures import EpisodeFigures, Looked, look_at
from wrenchflow.datasets.analysis.page import analysis_page
from wrenchflow.datasets.analysis.source import Source
from wrenchflow.datasets.analysis.tables import write_tables
from wrenchflow.datasets.analysis.totals import Totals
from wrenchflow.datasets.analysis.trajectory import Labels
from wrenchflow.episodes_map import map_episodes
from wrenchflow.errors import DatasetError, OutputError, WrenchflowError
from wrenchflow.manifest import output_folder, write_manifest

PAGE = "analysis.html"


def analyze(
    source: Source,
    path: Path,
    out: Path,
    config: AnalysisConfig,
    *,
    jobs: int = 1,
    overwrite: bool = False,
    executor: Executor | None = None,
) -> Iterator[Analysis | None]:
    """Look at every episode of a data set, one by one, and write what is known of all.

    Args:
        source: What reads them.
        path: Where the data set is; it is only read.
        out: Folder for `analysis.html`, Parquet tables and `analysis.json`. It is there once the iterator is exhausted.
        config: How.
        jobs: Worker processes.
        overwrite: Replace an analysis that is there.
        executor: Used in place of worker processes of its own.

    Yields:
        None after each episode; at the end, what is known.

    Raises:
        DatasetError: If there is no episode, or none can be looked at.
        OutputError: If the output is taken or cannot be made.
    """
    places = source.places()
    if not places:
        raise DatasetError(f"'{path}' has no episodes.")
    with output_folder(out, overwrite=overwrite, reads=[path]) as partial_out:
        totals = Totals()
        for looked in map_episodes(partial(_look, source, config), places, jobs=jobs, executor=executor):
            totals.add(looked)
            yield None
        if not totals.episodes:
            place, reason = totals.left_out[0]
            raise DatasetError(f"no episode of '{path}' can be looked at; the first, {place}: {reason}.")
        analysis = Analysis.of(source.kind, totals, config)
        try:
            write_tables(partial_out, analysis)
            (partial_out / PAGE).write_text(analysis_page(analysis))
            write_manifest(partial_out, "analyze", config)
        except (OSError, pa.ArrowException) as error:
            raise OutputError(f"output '{out}' cannot be written: {error}") from error
    yield analysis


def _look(source: Source, config: AnalysisConfig, place: str) -> Looked:
    try:
        # What comes to no number is counted, and told.
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            return look_at(source.read(place, config), config)
    except WrenchflowError as error:
        nothing = EpisodeFigures(
            id=place, place=place, labels=Labels(), values={}, missing=(), shape=np.zeros(0, np.float32), shape_of=""
        )
        return Looked(figures=nothing, left_out=str(error).rstrip("."))
