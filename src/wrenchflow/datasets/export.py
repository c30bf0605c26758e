"""The stage `export`: clean recordings to data sets that peers' tools load, in one pass and in flat memory."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np

from wrenchflow.datasets import lerobot, replay_buffer, robomimic, spreadsheet
from wrenchflow.datasets.about import About
from wrenchflow.datasets.checks import Admission
from wrenchflow.datasets.config import ExportConfig
from wrenchflow.datasets.curation.choose import everything, masks_by_quality
from wrenchflow.datasets.curation.review import EpisodeReview, apply_review, read_review
from wrenchflow.datasets.curation.selection import find, read_selection
from wrenchflow.datasets.grid import Grid
from wrenchflow.datasets.load import LEROBOT_NAME, ROBOMIMIC_NAME
from wrenchflow.datasets.pictures import cameras_of
from wrenchflow.datasets.sample import STREAMS, is_success, sample, topics_of
from wrenchflow.datasets.sink import Sink
from wrenchflow.episodes_map import map_episodes
from wrenchflow.errors import ConfigError, DatasetError, OutputError, WrenchflowError, unknown
from wrenchflow.manifest import sha256_of, write_manifest
from wrenchflow.observation import OBSERVATIONS, OPTIONAL, Steps
from wrenchflow.recording.reader import find_recordings, read_episode, read_info


@dataclass(frozen=True, kw_only=True)
class Format:
    """A kind of data set.

    Attributes:
        name: What it is called in the output folder.
        writing: What writes it.
        check: Raises a DatasetError for an episode that it cannot hold.
    """

    name: str
    writing: Callable[..., AbstractContextManager[Sink]]
    check: Callable[[Steps], object] = lambda steps: None


FORMATS: Mapping[str, Format] = MappingProxyType(
    {
        "robomimic": Format(name=ROBOMIMIC_NAME, writing=robomimic.writing),
        "lerobot": Format(name=LEROBOT_NAME, writing=lerobot.writing, check=lerobot.frames_per_second),
        "zarr": Format(name="replay_buffer.zarr", writing=replay_buffer.writing),
        "parquet": Format(name="steps.parquet", writing=spreadsheet.writing),
        "csv": Format(name="steps.csv", writing=spreadsheet.writing),
    }
)


@dataclass(frozen=True, kw_only=True)
class ExportedEpisode:
    """What became of a recording.

    Attributes:
        id: Its name.
        steps: Steps in the data set; 0 if it was left out.
        parts: Episodes that it became: gaps may divide it.
        invalid: Steps that are marked as not valid.
        left_out: Why it was, empty if it was not.
    """

    id: str
    steps: int = 0
    parts: int = 0
    invalid: int = 0
    left_out: str = ""


@dataclass(frozen=True, kw_only=True)
class _Item:
    """A recording that is to be exported."""

    path: Path
    review: EpisodeReview | None = None
    id: str = ""
    split: str = ""


@dataclass(frozen=True, kw_only=True)
class _Sampled:
    """What a worker sends back of a recording."""

    id: str
    sha256: str = ""
    group_delay_s: float | None = None
    parts: tuple[Steps, ...] = ()
    left_out: str = ""


def export_folder(
    formats: str,
    clean: Path,
    out: Path,
    config: ExportConfig,
    *,
    jobs: int = 1,
    overwrite: bool = False,
    executor: Executor | None = None,
) -> Iterator[ExportedEpisode]:
    """Make data sets of every recording in a folder.

    A recording that cannot be part of one is left out, and the reason is told; it is the first one that can which
    decides on filter, streams and cameras.

    Args:
        formats: Some of `FORMATS`, with commas between; each recording is read once.
        clean: Folder of processed `*.mcap`, or a selection of such; it is only read. What `review.json` in it says is
            done: trims, labels, tasks.
        out: Folder that gets `robomimic.hdf5` or `lerobot/`, and `<format>.manifest.json` beside it. It may hold the
            others already. A data set is there once the iterator is exhausted, and not before.
        config: How.
        jobs: Worker processes.
        overwrite: Replace data sets of these formats that are there.
        executor: Used in place of worker processes of its own.

    Yields:
        What became of each recording, in the order of the names.

    Raises:
        ConfigError: If there is no such format, or a mask is none.
        OutputError: If a data set is there already, or cannot be written.
        RecordingError: If there is nothing to read.
        DatasetError: If no recording can be part of the data set.
    """
    chosen = _formats(formats)
    if out.exists() and not out.is_dir():
        raise OutputError(f"output '{out}' is a file, expected a folder. Choose another place.")
    for format in chosen.values():
        if (out / format.name).exists() and not overwrite:
            raise OutputError(
                f"output '{out / format.name}' exists already. Choose another place, or pass --overwrite."
            )
    items = _items(clean)
    grid = _grid(config, [item.path for item in items])
    splits = {item.id: item.split for item in items if item.split}
    masks = masks_by_quality(everything(clean), config.masks) if config.masks else {}
    with ExitStack() as stack:
        data_set = _DataSet(chosen, out, config, splits, masks, stack, overwrite=overwrite)
        reasons: dict[str, str] = {}
        hashes: dict[str, str] = {}
        sampling = map_episodes(partial(_sample, config, grid), items, jobs=jobs, executor=executor)
        for item, sampled in zip(items, sampling, strict=True):
            hashes[item.path.name] = sampled.sha256
            if left_out := sampled.left_out or data_set.add(sampled):
                reasons[sampled.id] = left_out
                yield ExportedEpisode(id=sampled.id, left_out=left_out)
                continue
            yield ExportedEpisode(
                id=sampled.id,
                steps=sum(map(len, sampled.parts)),
                parts=len(sampled.parts),
                invalid=sum(_invalid(part) for part in sampled.parts),
            )
        if len(reasons) == len(items):
            id, reason = next(iter(reasons.items()))
            raise DatasetError(f"no recording in '{clean}' can be exported; the first, {id}: {reason}.")
    for name in chosen:
        write_manifest(out, f"export {name}", config, hashes, name=f"{name}.manifest.json")


class _DataSet:
    """The data sets that are being written, which are made when the first episode is there."""

    def __init__(
        self,
        formats: Mapping[str, Format],
        out: Path,
        config: ExportConfig,
        splits: Mapping[str, str],
        masks: Mapping[str, Collection[str]],
        stack: ExitStack,
        *,
        overwrite: bool,
    ) -> None:
        self._formats, self._out, self._config, self._stack = formats, out, config, stack
        self._splits, self._masks, self._overwrite = splits, masks, overwrite
        self._admission = Admission()
        self._group_delay_s: float | None = None
        self._sinks: list[Sink] = []

    def add(self, sampled: _Sampled) -> str:
        """Write a recording to all of them, or to none and say why."""
        if self._sinks and sampled.group_delay_s != self._group_delay_s:
            return f"its wrench lags {sampled.group_delay_s} s, expected {self._group_delay_s} s as that of the others"
        try:
            for part in sampled.parts:
                for format in self._formats.values():
                    format.check(part)
            self._admission.admit(sampled.parts)
        except DatasetError as error:
            return str(error).rstrip(".")
        if not self._sinks:
            self._group_delay_s = sampled.group_delay_s
            about = About(
                config=self._config,
                wrench_group_delay_s=sampled.group_delay_s,
                masks=self._masks,
                splits=self._splits,
            )
            self._sinks = [
                self._stack.enter_context(format.writing(self._out / format.name, about, overwrite=self._overwrite))
                for format in self._formats.values()
            ]
        for part in sampled.parts:
            for sink in self._sinks:
                sink.add(part)
        return ""


def _formats(wanted: str) -> Mapping[str, Format]:
    names = [name.strip() for name in wanted.split(",") if name.strip()]
    for name in names:
        if name not in FORMATS:
            raise ConfigError(unknown("format", name, FORMATS))
    if not names:
        raise ConfigError(f"no format is named. Available: {', '.join(FORMATS)}.")
    return {name: FORMATS[name] for name in names}


def _grid(config: ExportConfig, paths: Sequence[Path]) -> Grid:
    cameras = config.cameras
    if cameras is None:
        cameras = next((found for found in map(_cameras, paths) if found is not None), ())
    return Grid(
        rate_hz=config.rate,
        camera="" if config.grid == "rate" else config.grid,
        cameras=cameras,
        observations=tuple(name for name in OBSERVATIONS if config.force_window or name not in OPTIONAL),
        gaps=config.gaps,
    )


def _cameras(path: Path) -> tuple[str, ...] | None:
    """The cameras of a recording; None for one that cannot be read, which is told when its turn comes."""
    try:
        return cameras_of(read_info(path))
    except WrenchflowError:
        return None


def _invalid(steps: Steps) -> int:
    return int((~np.logical_and.reduce([*steps.valid.values(), np.ones(len(steps), bool)])).sum())


def _items(clean: Path) -> list[_Item]:
    """The recordings of a folder or of a selection, each with what a person said about it."""
    if clean.suffix == ".json":
        return [
            _Item(path=one.path, review=one.review, id=one.entry.id, split=one.entry.split)
            for one in find(read_selection(clean))
        ]
    said = read_review(clean).episodes
    return [_Item(path=path, review=said.get(path.name)) for path in find_recordings(clean)]


def _sample(config: ExportConfig, grid: Grid, item: _Item) -> _Sampled:
    path, review = item.path, item.review
    sampled = _Sampled(id=path.stem, sha256=sha256_of(path))
    if review is not None and review.sha256 != sampled.sha256:
        return replace(sampled, left_out="it is another recording than the one that review.json speaks of")
    if review is not None and review.label == "unusable":
        return replace(sampled, left_out="reviewed as unusable" + (f": {review.note}" if review.note else ""))
    try:
        # A trim counts from the first stamp of all.
        episode = read_episode(path, STREAMS if review is None else None, messages=topics_of(grid))
        if review is not None:
            episode = apply_review(episode, review)
        sampled = replace(sampled, id=episode.id)
        process = episode.meta.get("process")
        group_delay_s = process.get("group_delay_s") if isinstance(process, Mapping) else None
        if config.only_success and not is_success(episode):
            return replace(sampled, left_out="not a success")
        return replace(sampled, group_delay_s=group_delay_s, parts=sample(episode, grid))
    except WrenchflowError as error:
        return replace(sampled, left_out=str(error).removeprefix(f"episode {path.stem}: ").rstrip("."))
