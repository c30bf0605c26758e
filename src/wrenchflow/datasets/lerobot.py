"""Writes a LeRobotDataset v3.0 folder over pyarrow alone, an episode at a time.

LeRobot's policies see `observation.state` and `observation.environment_state` only, so the state carries the wrench.
What LeRobot has no place for (ids, success, units, how values were sampled) is in `meta/wrenchflow*`.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from wrenchflow.datasets import lerobot_layout as layout
from wrenchflow.datasets.about import About
from wrenchflow.datasets.arrow import array_of, values_of
from wrenchflow.datasets.grid import rate_of
from wrenchflow.datasets.masks import Member, masks_of
from wrenchflow.datasets.pixels import PixelCounts
from wrenchflow.datasets.running import Running
from wrenchflow.datasets.sink import add_all
from wrenchflow.datasets.summary import summarise
from wrenchflow.datasets.video import CameraVideos, Clip
from wrenchflow.errors import DatasetError, OutputError
from wrenchflow.manifest import output_folder, write_json
from wrenchflow.observation import Steps

_BATCH = 4096  # Rows that are read at once.
_KEPT_BYTES = 32 * 2**20
_ROWS = 100  # Episodes whose rows of the table of episodes are held until they are written.


def write(folder: Path, steps: Sequence[Steps], about: About, *, overwrite: bool = False) -> None:
    """Write episodes that are in memory; `writing` says the rest."""
    with writing(folder, about, overwrite=overwrite) as sink:
        add_all(sink, steps)


@contextmanager
def writing(folder: Path, about: About, *, overwrite: bool = False) -> Iterator["LeRobotSink"]:
    """Write a data set as a LeRobotDataset; equal steps give equal bytes.

    `action` is the target in physical units. LeRobot's splits are ranges of episodes, so ours are in
    `meta/wrenchflow.json`.

    Args:
        folder: The folder; it is called `<folder>.partial` until the block ends well.
        about: What is known of the whole.
        overwrite: Replace a folder that is there.

    Raises:
        DatasetError: If there was no episode.
        OutputError: If the place is taken or cannot be written to.
    """
    try:
        with output_folder(folder, overwrite=overwrite, mark=layout.INFO) as partial, ExitStack() as open_files:
            sink = LeRobotSink(partial, about, open_files)
            yield sink
            sink.finish()
    except (OSError, pa.ArrowException) as error:
        raise OutputError(f"output '{folder}' cannot be written: {error}") from error


class LeRobotSink:
    """Takes episodes into a folder."""

    def __init__(self, folder: Path, about: About, open_files: ExitStack) -> None:
        self._folder, self._about, self._open = folder, about, open_files
        self._first: Steps | None = None
        self._members: list[Member] = []
        self._tasks: list[str] = []
        self._running: dict[str, Running] = {}
        self._kept = _Kept()
        self._data = _Files(folder, open_files)
        self._episodes = _Rows(folder / layout.EPISODES, open_files)
        self._ours = _Rows(folder / layout.OUR_EPISODES, open_files)
        self._videos: list[CameraVideos] = []
        self._seen: dict[str, PixelCounts] = {}
        self._rate_hz = self._steps = 0

    def add(self, steps: Steps) -> None:
        """Write an episode."""
        self._first = self._first or steps
        self._rate_hz = frames_per_second(steps)
        if steps.task not in self._tasks:
            self._tasks.append(steps.task)
        number = len(self._members)
        columns = layout.columns(steps, self._steps, number, self._tasks.index(steps.task), self._rate_hz)
        statistics = {feature: summarise(values) for feature, values in columns.items()}
        for feature, values in columns.items():
            self._running.setdefault(feature, Running()).add(values, statistics[feature])
        self._kept.add(columns)
        clips = self._film(steps)
        statistics |= {feature: clip.counts.summary() for feature, clip in clips.items()}
        file_number = self._data.write(pa.table({name: array_of(values) for name, values in columns.items()}))
        self._episodes.add(_episode_row(columns, statistics, number, file_number, steps.task) | _places(clips))
        told = ("episode_id", "recording_id", "task", "operator", "success")
        self._ours.add({"episode_index": number, **{name: getattr(steps, name) for name in told}})
        self._members.append(Member.of(steps))
        self._steps += len(steps)

    def finish(self) -> None:
        """Write what is known of the whole."""
        first = self._first
        if first is None:
            raise DatasetError("there is no episode to export.")
        self._open.close()
        meta = self._folder / "meta"
        pq.write_table(layout.tasks_table(self._tasks), meta / "tasks.parquet")
        statistics = {feature: self._statistics(feature) for feature in self._running}
        statistics |= {feature: counts.summary() for feature, counts in self._seen.items()}
        write_json(meta / "stats.json", {feature: _plain(of) for feature, of in statistics.items()})
        totals = {"episodes": len(self._members), "steps": self._steps, "tasks": len(self._tasks)}
        info = layout.info(
            first, self._rate_hz, **totals, videos={video.feature: video.described for video in self._videos}
        )
        (self._folder / layout.INFO).write_text(json.dumps(info, indent=4) + "\n")
        masks = masks_of(self._members, self._about)
        write_json(self._folder / layout.OURS, layout.ours(first, self._about.described(first), masks))

    def _film(self, steps: Steps) -> dict[str, Clip]:
        """Encode an episode's pictures; where each camera's lie, by feature."""
        if not self._videos:
            for camera, pictures in steps.pictures.items():
                self._videos.append(CameraVideos(self._folder, camera, self._rate_hz, pictures[0]))
                self._open.callback(self._videos[-1].close)
        clips = {
            video.feature: video.add(pictures)
            for video, pictures in zip(self._videos, steps.pictures.values(), strict=True)
        }
        for feature, clip in clips.items():
            self._seen[feature] = self._seen.get(feature, PixelCounts()) + clip.counts
        return clips

    def _statistics(self, feature: str) -> dict[str, np.ndarray]:
        """Those of all values of a feature, which are in memory while they are few, and in the files."""
        if self._kept.has_all:
            return summarise(np.concatenate(self._kept.of(feature)))

        def blocks() -> Iterator[np.ndarray]:
            for path in self._data.paths:
                # Read ahead, Arrow would hold the whole column.
                with pq.ParquetFile(path, pre_buffer=False) as file:
                    for batch in file.iter_batches(batch_size=_BATCH, columns=[feature]):
                        yield values_of(batch.column(0))

        return self._running[feature].result(blocks)


def frames_per_second(steps: Steps) -> int:
    """LeRobot's whole number of frames a second, if it is true of an episode.

    Raises:
        DatasetError: If it is not.
    """
    rate_hz = rate_of(steps.period_ns)
    if rate_hz.denominator != 1:
        raise DatasetError(f"LeRobot takes a whole number of steps a second, got {rate_hz} Hz.")
    # LeRobot takes the stamps of a picture to be multiples of the period, and so does whoever reads `timestamp`.
    late_ns = np.abs(steps.t - steps.t[0] - np.arange(len(steps)) * (1_000_000_000 / int(rate_hz))).max()
    if late_ns > steps.period_ns / 2:
        raise DatasetError(
            f"LeRobot takes a step every 1/{rate_hz} s, but a step of episode {steps.episode_id} is "
            f"{late_ns * 1e-6:.1f} ms off that. Say at which rate pictures come (--rate-hz), or take a grid at a rate."
        )
    return int(rate_hz)


class _Kept:
    """All values, as long as they are few."""

    def __init__(self) -> None:
        self._columns: list[Mapping[str, np.ndarray]] = []
        self._bytes = 0

    @property
    def has_all(self) -> bool:
        """Whether nothing had to go."""
        return self._bytes <= _KEPT_BYTES

    def add(self, columns: Mapping[str, np.ndarray]) -> None:
        self._bytes += sum(values.nbytes for values in columns.values())
        self._columns = [*self._columns, columns] if self.has_all else []

    def of(self, feature: str) -> list[np.ndarray]:
        return [columns[feature] for columns in self._columns]


class _Table:
    """A Parquet file that is written in parts."""

    def __init__(self, path: Path, schema: pa.Schema) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        # Sensor values hardly repeat: a dictionary of them takes time, and saves nothing.
        self._writer = pq.ParquetWriter(path, schema, compression="zstd", use_dictionary=False, write_statistics=False)

    def write(self, table: pa.Table) -> None:
        self._writer.write_table(table, row_group_size=len(table))

    def close(self) -> None:
        self._writer.close()


class _Files:
    """Data files, one after the other, with a row group an episode."""

    def __init__(self, folder: Path, open_files: ExitStack) -> None:
        self._folder = folder
        self._file: _Table | None = None
        self._bytes = 0
        self.paths: list[Path] = []
        open_files.callback(self.close)

    def write(self, table: pa.Table) -> int:
        """Write an episode, and say the number of the file that it went to."""
        if self._file is None or self._bytes + table.nbytes > layout.FILE_MB * 2**20:
            self.close()
            self.paths.append(self._folder / layout.data_path(len(self.paths)))
            self._file, self._bytes = _Table(self.paths[-1], table.schema), 0
        self._file.write(table)
        self._bytes += table.nbytes
        return len(self.paths) - 1

    def close(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None


class _Rows:
    """A table that grows by a row, of which a few are held."""

    def __init__(self, path: Path, open_files: ExitStack) -> None:
        self._path = path
        self._file: _Table | None = None
        self._held: list[dict[str, Any]] = []
        open_files.callback(self.close)

    def add(self, row: dict[str, Any]) -> None:
        self._held.append(row)
        if len(self._held) == _ROWS:
            self._flush()

    def close(self) -> None:
        if self._held:
            self._flush()
        if self._file is not None:
            self._file.close()

    def _flush(self) -> None:
        table = pa.Table.from_pylist(self._held)
        self._file = self._file or _Table(self._path, table.schema)
        self._file.write(table)
        self._held.clear()


def _episode_row(
    columns: Mapping[str, np.ndarray],
    statistics: Mapping[str, Mapping[str, np.ndarray]],
    episode: int,
    file_number: int,
    task: str,
) -> dict[str, Any]:
    index = columns["index"]
    return {
        "episode_index": episode,
        "tasks": [task],
        "length": len(index),
        **{f"data/{name}": number for name, number in layout.place(file_number).items()},
        "dataset_from_index": int(index[0]),
        "dataset_to_index": int(index[-1]) + 1,
        **{
            f"stats/{feature}/{name}": value for feature, of in statistics.items() for name, value in _plain(of).items()
        },
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }


def _places(clips: Mapping[str, Clip]) -> dict[str, Any]:
    """Where an episode's videos are, as LeRobot's table of episodes says it."""
    found: dict[str, Any] = {}
    for feature, clip in clips.items():
        at = {**layout.place(clip.file_number), "from_timestamp": clip.start_s, "to_timestamp": clip.stop_s}
        found |= {f"videos/{feature}/{name}": value for name, value in at.items()}
    return found


def _plain(statistics: Mapping[str, np.ndarray]) -> dict[str, Any]:
    return {
        name: (value.astype(np.int64) if value.dtype == bool else value).tolist() for name, value in statistics.items()
    }
