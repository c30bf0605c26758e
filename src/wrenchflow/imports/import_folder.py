"""The command `import`: foreign recordings to raw ones."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from wrenchflow.episode import Episode
from wrenchflow.episodes_map import map_episodes
from wrenchflow.errors import ConfigError, RecordingError, StreamError, unknown
from wrenchflow.imports.imported_episode import import_take
from wrenchflow.imports.mapping import FileLayout, ImportMapping, load_mapping
from wrenchflow.imports.matlab import read_matlab
from wrenchflow.imports.mcap_topics import McapTopics
from wrenchflow.imports.table import Table
from wrenchflow.imports.take import Take
from wrenchflow.manifest import output_folder, sha256_of, write_manifest
from wrenchflow.recording.write import write_episode
from wrenchflow.rig import Rig, load_rig

_TABLES, _MATLAB, _MCAP = (".csv", ".tsv", ".txt"), ".mat", ".mcap"


@dataclass(frozen=True, kw_only=True)
class ImportedEpisode:
    """What came of one take.

    Attributes:
        id: Name of the episode.
        samples: Of each stream.
        notes: What had to be assumed, was left out, or looks wrong, in sentences.
    """

    id: str
    samples: Mapping[str, int]
    notes: tuple[str, ...]


def import_folder(
    mapping_file: Path,
    out: Path,
    files: Sequence[Path],
    *,
    jobs: int = 1,
    overwrite: bool = False,
    executor: Executor | None = None,
) -> Iterator[tuple[ImportedEpisode, ...]]:
    """Import foreign recordings.

    Args:
        mapping_file: TOML that says what they hold.
        out: Folder that gets `<id>.mcap` and `manifest.json`. It is complete once the iterator is exhausted, and does
            not exist before.
        files: Tables, MATLAB files, MCAP files, or folders of ROS 2 bags.
        jobs: Worker processes.
        overwrite: Replace `out` if it is there.
        executor: Used in place of worker processes of its own.

    Yields:
        What came of each file, in their order.

    Raises:
        ConfigError: If the mapping makes no sense, or leaves out what a file shows to be needed.
        RecordingError: If a file cannot be read, or does not hold what the mapping says.
        OutputError: If `out` is taken.
    """
    mapping = load_mapping(mapping_file)
    rig = load_rig(mapping.rig, mapping_file.parent) if mapping.rig else None
    if not files:
        raise ConfigError("no file to import is given, expected one at least.")
    again = [name for name, count in Counter(map(_name, files)).items() if count > 1]
    if again:
        raise ConfigError(f"{len(files)} files are to be imported, and several would become episode '{again[0]}'.")
    with output_folder(out, overwrite=overwrite, reads=[mapping_file, *files]) as folder:
        work = partial(_import_file, folder, mapping, rig, mapping_file.name)
        yield from map_episodes(work, files, jobs=jobs, executor=executor)
        write_manifest(folder, "import", mapping, [each for file in files for each in _files_of(file)])


def _name(path: Path) -> str:
    return path.resolve().name if path.is_dir() else path.stem


def _import_file(
    folder: Path, mapping: ImportMapping, rig: Rig | None, where: str, path: Path
) -> tuple[ImportedEpisode, ...]:
    takes = open_takes(path, mapping.file)
    hashes = {file.name: sha256_of(file) for file in _files_of(path)}
    return tuple(_written(folder, import_take(take, mapping, rig, where, hashes), path) for take in takes)


def _written(folder: Path, episode: Episode, path: Path) -> ImportedEpisode:
    try:
        write_episode(folder / f"{episode.id}.mcap", episode)
    except StreamError as error:
        raise RecordingError(f"{path} cannot be recorded: {error}") from error
    return ImportedEpisode(
        id=episode.id,
        samples={name: len(stream) for name, stream in episode.streams.items()},
        notes=tuple(episode.meta["import"]["notes"]),
    )


def open_takes(path: Path, layout: FileLayout) -> Sequence[Take]:
    """Open a foreign file, by what its name ends in; a folder is a bag.

    Raises:
        RecordingError: If it cannot be read.
        ConfigError: If it is of a kind that is not known, or needs a package that is not there.
    """
    suffix = path.suffix.lower()
    if path.is_dir():
        try:
            from wrenchflow.imports.bag import BagTopics
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] != "rosbags":
                raise
            raise ConfigError("this needs rosbags, which is not installed: install wrenchflow[import].") from error
        return (BagTopics(path),)
    if suffix == ".db3":
        raise ConfigError(
            f"'{path}' is a part of a ROS 2 bag: give the folder that it lies in, with its metadata.yaml."
        )
    if suffix in _TABLES:
        return (Table(path, layout),)
    if suffix == _MATLAB:
        return read_matlab(path, layout)
    if suffix == _MCAP:
        return (McapTopics(path),)
    raise ConfigError(
        f"'{path.name}': {unknown('ending', suffix, (*_TABLES, _MATLAB, _MCAP))} A ROS 2 bag is a folder."
    )


def _files_of(path: Path) -> list[Path]:
    return sorted(each for each in path.iterdir() if each.is_file()) if path.is_dir() else [path]
