"""Says something about one recording, and refuses what the recording cannot hold."""

from dataclasses import replace
from pathlib import Path

from wrenchflow.datasets.curation.review import EpisodeReview, Mark, apply_review, read_review, write_review
from wrenchflow.errors import ConfigError, DatasetError, unknown
from wrenchflow.manifest import sha256_of
from wrenchflow.recording.reader import find_recordings, read_episode


def edit_review(
    folder: Path,
    episode: str,
    *,
    trim_s: tuple[float, float] | None = None,
    label: str = "",
    task: str = "",
    marks: tuple[str, ...] = (),
    note: str = "",
    by: str = "",
    clear: bool = False,
) -> EpisodeReview | None:
    """Add to what is said about a recording; what is not given stays as it is.

    Args:
        folder: Where the recording is.
        episode: Its name, with or without `.mcap`.
        trim_s: What is kept, since its first stamp [s].
        label: What came of it.
        task: What was attempted.
        marks: Parts with names, `name:start:stop` [s]; they join those that are there.
        note: Anything else.
        by: Who says so.
        clear: Say nothing about it any more.

    Returns:
        What is said now.

    Raises:
        ConfigError: If there is no such recording, or a mark or trim is none.
        DatasetError: If the recording does not last that long, or what is there was said of another recording.
    """
    files = {path.stem: path for path in find_recordings(folder)}
    name = episode.removesuffix(".mcap")
    if name not in files:
        raise ConfigError(unknown("episode", name, files))
    path, review = files[name], read_review(folder)
    if clear:
        write_review(folder, review.with_(path.name, None))
        return None
    sha256 = sha256_of(path)
    said = review.episodes.get(path.name, EpisodeReview(sha256=sha256))
    if said.sha256 != sha256:
        raise DatasetError(f"what is said about '{path.name}' was said about another recording: --clear it first.")
    start_s, stop_s = trim_s or (said.start_s, said.stop_s)
    said = replace(
        said,
        label=label or said.label,
        task=task or said.task,
        start_s=start_s,
        stop_s=stop_s,
        marks=(*said.marks, *map(_mark, marks)),
        note=note or said.note,
        by=by or said.by,
    )
    apply_review(read_episode(path), said)  # Refuses what does not fit.
    write_review(folder, review.with_(path.name, said))
    return said


def _mark(text: str) -> Mark:
    name, *numbers = text.rsplit(":", 2)
    try:
        start_s, stop_s = map(float, numbers)
    except ValueError as error:
        raise ConfigError(
            f"mark '{text}' is none, expected NAME:START:STOP in seconds, as in insert:2.0:3.1."
        ) from error
    return Mark(name=name, start_s=start_s, stop_s=stop_s)
