"""The stage `export`: clean recordings to a data set that peers' tools load."""

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import MappingProxyType

from wrenchflow.datasets import lerobot, robomimic
from wrenchflow.datasets.config import ExportConfig
from wrenchflow.datasets.grid import STREAMS, is_success, to_steps
from wrenchflow.datasets.keys import About
from wrenchflow.datasets.load import LEROBOT_NAME, ROBOMIMIC_NAME
from wrenchflow.episodes_map import map_episodes
from wrenchflow.errors import ConfigError, DatasetError, OutputError, unknown
from wrenchflow.manifest import write_manifest
from wrenchflow.observation import Steps
from wrenchflow.recording.reader import find_recordings, read_episode


@dataclass(frozen=True, kw_only=True)
class Format:
    """A kind of data set: what it is called in the output folder, and what writes it."""

    name: str
    write: Callable[..., None]


FORMATS: Mapping[str, Format] = MappingProxyType(
    {
        "robomimic": Format(name=ROBOMIMIC_NAME, write=robomimic.write),
        "lerobot": Format(name=LEROBOT_NAME, write=lerobot.write),
    }
)


@dataclass(frozen=True, kw_only=True)
class ExportedEpisode:
    """What became of an episode.

    Attributes:
        id: Its name.
        steps: Steps in the data set; 0 if it was left out.
        left_out: Why it was, empty if it was not.
    """

    id: str
    steps: int
    left_out: str = ""


@dataclass(frozen=True, kw_only=True)
class _Sampled:
    """What a worker sends back of an episode."""

    id: str
    about: About
    steps: Steps | None


def export_folder(
    format: str,
    clean: Path,
    out: Path,
    config: ExportConfig,
    *,
    jobs: int = 1,
    overwrite: bool = False,
    executor: Executor | None = None,
) -> Iterator[ExportedEpisode]:
    """Make a data set of every recording in a folder.

    Args:
        format: One of `FORMATS`.
        clean: Folder of processed `*.mcap`; it is only read.
        out: Folder that gets `robomimic.hdf5` or `lerobot/`, and `<format>.manifest.json` beside it. It may hold the
            other already. The data set is there once the iterator is exhausted, and not before.
        config: How.
        jobs: Worker processes.
        overwrite: Replace a data set of this format that is there.
        executor: Used in place of worker processes of its own.

    Yields:
        What became of each episode, in the order of the names.

    Raises:
        ConfigError: If there is no such format.
        OutputError: If the data set is there already, or cannot be written.
        RecordingError: If there is nothing to read, or a recording is damaged or was not processed.
        DatasetError: If an episode cannot be sampled, tasks differ, or no episode is left.
    """
    if format not in FORMATS:
        raise ConfigError(unknown("format", format, FORMATS))
    target = out / FORMATS[format].name
    if target.exists() and not overwrite:
        raise OutputError(f"output '{target}' exists already. Choose another place, or pass --overwrite.")
    if out.exists() and not out.is_dir():
        raise OutputError(f"output '{out}' is a file, expected a folder. Choose another place.")
    paths = find_recordings(clean)
    about: About | None = None
    kept: list[Steps] = []
    for sampled in map_episodes(partial(_sample, config), paths, jobs=jobs, executor=executor):
        if sampled.steps is None:
            yield ExportedEpisode(id=sampled.id, steps=0, left_out="not a success")
            continue
        about = about or sampled.about
        if sampled.about != about:
            raise DatasetError(
                f"episode {sampled.id} is {_said(sampled.about)}, expected {_said(about)} as in episode "
                f"{kept[0].episode_id}."
            )
        kept.append(sampled.steps)
        yield ExportedEpisode(id=sampled.id, steps=len(sampled.steps))
    if about is None:
        raise DatasetError(f"none of the {len(paths)} episodes in '{clean}' says that it succeeded; nothing to export.")
    FORMATS[format].write(target, kept, about, valid_fraction=config.valid_fraction, overwrite=overwrite)
    write_manifest(out, f"export {format}", config, paths, name=f"{format}.manifest.json")


def _said(about: About) -> str:
    lag = "an unknown lag" if about.wrench_group_delay_s is None else f"{about.wrench_group_delay_s:g} s of lag"
    return f"of task '{about.task}' with {lag} in its wrench"


def _sample(config: ExportConfig, path: Path) -> _Sampled:
    episode = read_episode(path, STREAMS)
    process = episode.meta.get("process")
    group_delay_s = process.get("group_delay_s") if isinstance(process, Mapping) else None
    about = About(task=episode.task, wrench_group_delay_s=group_delay_s)
    is_wanted = is_success(episode) or not config.only_success
    return _Sampled(id=episode.id, about=about, steps=to_steps(episode, config.rate) if is_wanted else None)
