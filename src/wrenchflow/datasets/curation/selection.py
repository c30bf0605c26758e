"""Which recordings make a data set: by reference, with the reason of each that is left out, and where all came from."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from wrenchflow import __version__
from wrenchflow.config import from_mapping, to_mapping
from wrenchflow.datasets.curation.review import NAME as REVIEW
from wrenchflow.datasets.curation.review import EpisodeReview, read_review
from wrenchflow.errors import ConfigError, DatasetError, OutputError
from wrenchflow.manifest import read_json, read_manifest, sha256_of, write_json

FORMAT = 1
SUFFIX = ".selection.json"


@dataclass(frozen=True, kw_only=True)
class Entry:
    """A recording that is meant.

    Attributes:
        folder: Its folder, relative to the selection's file.
        file: Its name.
        sha256: Hash of its bytes: another file of its name is not meant.
        id: Its id.
        task: Its task.
        operator: Who demonstrated; empty where nobody says.
        success: What came of it; None where nobody says.
        raw_sha256: Hash of the raw recording that it was made of; empty where nobody says.
        split: `train`, `valid`, `test`, or empty.
        reason: Why it is left out; empty for one that is not.
    """

    folder: str
    file: str
    sha256: str
    id: str
    task: str = ""
    operator: str = ""
    success: bool | None = None
    raw_sha256: str = ""
    split: str = ""
    reason: str = ""

    @property
    def demonstration(self) -> str:
        """What has to stay on one side of a split: everything that was made of one raw recording."""
        return self.raw_sha256 or self.id


@dataclass(frozen=True, kw_only=True)
class Selection:
    """Recordings, in order.

    Attributes:
        entries: Those that are meant.
        left_out: Those that are not, each with its reason.
        made_by: What was done, in order: the command and what it was told.
        sources: Where recordings came from: the folder, and what its manifest says of version and configuration.
    """

    entries: tuple[Entry, ...]
    left_out: tuple[Entry, ...] = ()
    made_by: tuple[Mapping[str, Any], ...] = ()
    sources: tuple[Mapping[str, Any], ...] = field(default_factory=tuple)

    def then(self, command: str, **told: Any) -> "Selection":
        """The same, with one more thing that was done."""
        return replace(self, made_by=(*self.made_by, {"command": command, "wrenchflow": __version__, **told}))


@dataclass(frozen=True, kw_only=True)
class Chosen:
    """A recording of a selection, found.

    Attributes:
        path: Where it is.
        entry: What the selection says of it.
        review: What a person said about it; None for nothing.
    """

    path: Path
    entry: Entry
    review: EpisodeReview | None


def read_selection(path: Path) -> Selection:
    """Read a selection; its folders become relative to where this runs.

    Raises:
        RecordingError: If it is not there, or not JSON.
        DatasetError: If it is no selection.
    """
    said: Any = read_json(path)
    try:
        if said["format"] != FORMAT:
            raise DatasetError(f"'{path}' has format {said['format']}, expected {FORMAT}.")
        entries, left_out = (
            tuple(_moved(from_mapping(Entry, each, where=path.name), path.parent) for each in said[name])
            for name in ("entries", "left_out")
        )
        return Selection(
            entries=entries, left_out=left_out, made_by=tuple(said["made_by"]), sources=tuple(said["sources"])
        )
    except (ConfigError, KeyError, TypeError) as error:
        raise DatasetError(f"'{path}' is no selection: {error}") from error


def _moved(entry: Entry, folder: Path) -> Entry:
    return replace(entry, folder=os.path.normpath(folder / entry.folder))


def write_selection(path: Path, selection: Selection, *, overwrite: bool = False) -> None:
    """Write a selection; folders become relative to its file, so that both can be moved together.

    Raises:
        OutputError: If the path is taken, or cannot be written.
    """
    if path.exists() and not overwrite:
        raise OutputError(f"output '{path}' exists already. Choose another place, or pass --overwrite.")

    def beside(folder: str) -> str:
        return os.path.relpath(Path(folder).resolve(), path.parent.resolve())

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json(
            path,
            {
                "format": FORMAT,
                "entries": [to_mapping(replace(each, folder=beside(each.folder))) for each in selection.entries],
                "left_out": [to_mapping(replace(each, folder=beside(each.folder))) for each in selection.left_out],
                "made_by": [dict(each) for each in selection.made_by],
                "sources": [dict(each) for each in selection.sources],
            },
        )
    except OSError as error:
        raise OutputError(f"output '{path}' cannot be written: {error}") from error


def source_of(folder: Path) -> dict[str, Any]:
    """What a folder's manifest says of how its recordings were made; the folder by its name alone."""
    if not (folder / "manifest.json").exists():
        return {"folder": folder.resolve().name}
    manifest = read_manifest(folder)
    return {
        "folder": folder.resolve().name,
        "manifest_sha256": sha256_of(folder / "manifest.json"),
        **{key: manifest.get(key) for key in ("stage", "versions", "config")},
    }


def find(selection: Selection) -> list[Chosen]:
    """The recordings of a selection, each checked to be the one that is meant, with what was said about it.

    Raises:
        DatasetError: If one is missing or has changed, or its review is of another recording.
    """
    reviews = {folder: read_review(Path(folder)) for folder in {entry.folder for entry in selection.entries}}
    return [_found(entry, reviews[entry.folder].episodes.get(entry.file)) for entry in selection.entries]


def _found(entry: Entry, review: EpisodeReview | None) -> Chosen:
    path = Path(entry.folder, entry.file)
    if not path.is_file():
        raise DatasetError(f"'{path}' is selected and not there.")
    if sha256_of(path) != entry.sha256:
        raise DatasetError(f"'{path}' is another recording than the one that was selected: select it anew.")
    if review is not None and review.sha256 != entry.sha256:
        raise DatasetError(f"'{path}' is another recording than the one that {REVIEW} speaks of: review it anew.")
    return Chosen(path=path, entry=entry, review=review)


def require_entries(entries: Sequence[Entry], what: str) -> None:
    """Refuse a selection that selects nothing."""
    if not entries:
        raise DatasetError(f"{what} selects no recording.")
