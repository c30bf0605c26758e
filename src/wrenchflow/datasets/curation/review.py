"""What a person says about recordings after looking at them: kept beside the data, which stay as they are."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from wrenchflow.config import from_mapping, to_mapping
from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import ConfigError, DatasetError
from wrenchflow.manifest import read_json, write_json

NAME = "review.json"
_FORMAT = 1
_LEAST = 2  # Samples that a trim has to leave of each stream.


@dataclass(frozen=True, kw_only=True)
class Mark:
    """A part of an episode that has a name, such as a sub-task.

    Attributes:
        name: What it is.
        start_s: Its start, since the first stamp of the episode [s].
        stop_s: Its end [s].
    """

    name: str
    start_s: float
    stop_s: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.start_s < self.stop_s:
            raise ConfigError(f"mark '{self.name}' goes from {self.start_s:g} to {self.stop_s:g} s, expected forward.")


@dataclass(frozen=True, kw_only=True)
class EpisodeReview:
    """What is said about one recording.

    Attributes:
        sha256: Hash of the recording that was looked at: another one of its name is not meant.
        label: What came of it, whatever the recording says; `unusable` keeps it out of every data set; empty for what
            the recording says.
        task: The task, whatever the recording says; empty for what the recording says.
        start_s: What is before that is cut off, since the first stamp [s]; None for nothing.
        stop_s: What is after that is cut off [s]; None for nothing.
        marks: Parts that have names.
        note: Anything else.
        by: Who says so.
    """

    sha256: str
    label: Literal["", "success", "failure", "unusable"] = ""
    task: str = ""
    start_s: float | None = None
    stop_s: float | None = None
    marks: tuple[Mark, ...] = ()
    note: str = ""
    by: str = ""

    def __post_init__(self) -> None:
        start_s, stop_s = self.start_s or 0.0, float("inf") if self.stop_s is None else self.stop_s
        if not 0.0 <= start_s < stop_s:
            raise ConfigError(f"a trim from {start_s:g} to {stop_s:g} s leaves nothing, expected 0 <= start < stop.")
        for name in {mark.name for mark in self.marks}:
            same = sorted((mark.start_s, mark.stop_s) for mark in self.marks if mark.name == name)
            if any(first[1] > second[0] for first, second in pairwise(same)):
                raise ConfigError(f"marks '{name}' overlap.")


@dataclass(frozen=True, kw_only=True)
class Review:
    """What is said about the recordings of a folder.

    Attributes:
        episodes: By the name of the recording's file.
    """

    episodes: Mapping[str, EpisodeReview] = field(default_factory=dict)

    def with_(self, file: str, said: EpisodeReview | None) -> "Review":
        """The same with something said about a recording, or with nothing said about it any more."""
        others = {name: each for name, each in self.episodes.items() if name != file}
        return replace(self, episodes=others if said is None else {**others, file: said})


def read_review(folder: Path) -> Review:
    """What is said in a folder; nothing where there is no `review.json`.

    Raises:
        RecordingError: If the file is not JSON.
        DatasetError: If it says something else than a review.
    """
    path = folder / NAME
    if not path.exists():
        return Review()
    said: Any = read_json(path)
    try:
        if said["format"] != _FORMAT:
            raise DatasetError(f"'{path}' has format {said['format']}, expected {_FORMAT}.")
        return Review(
            episodes={
                str(name): from_mapping(EpisodeReview, each, where=f"{NAME}: {name}")
                for name, each in said["episodes"].items()
            }
        )
    except (AttributeError, KeyError, TypeError) as error:
        raise DatasetError(f"'{path}' is no review: {error!r}.") from error
    except ConfigError as error:
        raise DatasetError(f"'{path}' is no review: {error}") from error


def write_review(folder: Path, review: Review) -> None:
    """Write what is said in a folder, as a whole or not at all."""
    episodes = {name: to_mapping(each) for name, each in sorted(review.episodes.items())}
    write_json(folder / NAME, {"format": _FORMAT, "episodes": episodes})


def apply_review(episode: Episode, said: EpisodeReview) -> Episode:
    """An episode as it was reviewed: cut, with its label and task, and with marks as events.

    Raises:
        DatasetError: If the trim leaves less than two samples of a stream that had them, or a mark lies outside.
    """
    zero_ns, end_ns = episode.span_ns
    start_ns = zero_ns if said.start_s is None else zero_ns + round(said.start_s * 1e9)
    stop_ns = end_ns + 1 if said.stop_s is None else zero_ns + round(said.stop_s * 1e9)
    last_s = (end_ns - zero_ns) * 1e-9
    if start_ns > end_ns or stop_ns > end_ns + 1:
        raise DatasetError(f"its review trims it to {said.start_s} to {said.stop_s} s, but it lasts {last_s:.3f} s.")
    marks = []
    for mark in said.marks:
        at = (zero_ns + round(mark.start_s * 1e9), zero_ns + round(mark.stop_s * 1e9))
        if at[1] > end_ns + 1:
            raise DatasetError(f"mark '{mark.name}' ends at {mark.stop_s:g} s, but it lasts {last_s:.3f} s.")
        marks.append(Event(*at, "mark", mark.name))
    streams = {name: _cut(name, stream, start_ns, stop_ns) for name, stream in episode.streams.items()}
    events = [_clipped(event, start_ns, stop_ns) for event in (*episode.events, *marks)]
    reviewed = replace(
        episode,
        task=said.task or episode.task,
        streams=streams,
        events=tuple(event for event in events if event is not None),
    )
    if said.label in ("success", "failure"):
        result = episode.meta.get("result")
        told = dict(result) if isinstance(result, Mapping) else {}
        reviewed = reviewed.with_meta(result=told | {"success": said.label == "success"})
    return reviewed


def _cut(name: str, stream: Stream, start_ns: int, stop_ns: int) -> Stream:
    """A stream's samples in a span. What is said on change keeps what was said last before it."""
    cut = stream.between(start_ns, stop_ns)
    if name == "goal_pose":
        before = stream.between(int(stream.t[0]), start_ns) if len(stream) else stream
        if len(before) and (not len(cut) or cut.t[0] > start_ns):
            last = replace(before, t=before.t[-1:] * 0 + start_ns, data=before.data[-1:])
            return replace(cut, t=np.concatenate([last.t, cut.t]), data=np.concatenate([last.data, cut.data]))
        return cut
    if len(stream) >= _LEAST > len(cut):
        raise DatasetError(f"its review leaves {len(cut)} samples of '{name}', expected {_LEAST} or more.")
    return cut


def _clipped(event: Event, start_ns: int, stop_ns: int) -> Event | None:
    """What of an event lies in a span."""
    if event.stop_ns < start_ns or event.start_ns >= stop_ns:
        return None
    return replace(event, start_ns=max(event.start_ns, start_ns), stop_ns=min(event.stop_ns, stop_ns))
