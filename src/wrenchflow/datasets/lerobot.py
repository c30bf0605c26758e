"""Steps to and from a LeRobotDataset v3.0 folder, over pyarrow alone.

LeRobot's policies see `observation.state` and `observation.environment_state` only, so the state carries the wrench.
What LeRobot has no place for (ids, success, units, how the wrench was made) is in `meta/wrenchflow.json`.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from wrenchflow.config import from_mapping
from wrenchflow.datasets import lerobot_layout as layout
from wrenchflow.datasets.checks import require_exportable, require_values
from wrenchflow.datasets.grid import rate_of
from wrenchflow.datasets.keys import About, from_keys, to_keys
from wrenchflow.datasets.summary import summarise
from wrenchflow.errors import ConfigError, DatasetError, RecordingError
from wrenchflow.force_filter import FilterConfig
from wrenchflow.manifest import output_folder, read_json, write_json
from wrenchflow.observation import ACTION_WIDTH, Steps


def write(
    folder: Path, steps: Sequence[Steps], about: About, *, valid_fraction: float = 0.1, overwrite: bool = False
) -> None:
    """Write a data set as a LeRobotDataset; equal steps give equal bytes.

    Actions are in physical units. LeRobot's splits are ranges of episodes, so ours is in `meta/wrenchflow.json`.

    Args:
        folder: The folder; it is called `<folder>.partial` until it is whole.
        steps: One entry an episode.
        about: What is known of the whole.
        valid_fraction: Share of the episodes that is named for validation.
        overwrite: Replace a folder that is there.

    Raises:
        DatasetError: If the steps cannot make one data set, or their rate is no whole number of steps a second.
        OutputError: If the place is taken or cannot be written to.
    """
    require_exportable(steps)
    rate_hz = rate_of(steps[0].period_ns)
    if rate_hz.denominator != 1:
        raise DatasetError(f"LeRobot takes a whole number of steps a second, got {rate_hz} Hz.")
    with output_folder(folder, overwrite=overwrite, mark="meta/info.json") as partial:
        (partial / "meta" / "episodes" / "chunk-000").mkdir(parents=True)
        firsts = np.cumsum([0, *(len(one) for one in steps)])
        episodes = [_columns(one, int(firsts[i]), i, int(rate_hz)) for i, one in enumerate(steps)]
        rows = _write_data(partial, episodes, about.task)
        pq.write_table(pa.Table.from_pylist(rows), partial / layout.EPISODES, compression="zstd")
        pq.write_table(layout.tasks_table(about.task), partial / "meta" / "tasks.parquet")
        write_json(partial / "meta" / "stats.json", _statistics(episodes))
        (partial / layout.INFO).write_text(json.dumps(layout.info(steps, int(rate_hz)), indent=4) + "\n")
        write_json(partial / layout.OURS, layout.ours(steps, about, valid_fraction))


def read(folder: Path) -> list[Steps]:
    """Read and check a folder that `write` made.

    Raises:
        DatasetError: If it is missing, of another layout, inconsistent, or holds values that are not finite.
    """
    where = f"'{folder}'"
    if not folder.is_dir():
        raise DatasetError(f"data set {where} does not exist.")
    try:
        info, ours = read_json(folder / layout.INFO), read_json(folder / layout.OURS)
    except RecordingError as error:
        raise DatasetError(
            f"{where} is not a LeRobot data set of wrenchflow, which has {layout.INFO} and {layout.OURS}: {error}"
        ) from error
    try:
        if info["codebase_version"] != layout.CODEBASE_VERSION or int(ours["format"]) > layout.FORMAT_VERSION:
            raise DatasetError(
                f"{where} is LeRobot {info['codebase_version']}, format {ours['format']}; this wrenchflow reads "
                f"{layout.CODEBASE_VERSION}, formats up to {layout.FORMAT_VERSION}."
            )
        episodes = pq.read_table(folder / layout.EPISODES).to_pylist()
        if len(ours["episodes"]) != len(episodes):
            raise DatasetError(
                f"{where} has {len(episodes)} episodes, but {layout.OURS} names {len(ours['episodes'])}."
            )
        # Without it, as it was before it could be set.
        felt = from_mapping(FilterConfig, ours.get("wrench_filter", {}), "wrench_filter")
        steps = [
            _read_steps(table, said, int(ours["period_ns"]), f"{where}: episode {said['id']}")
            for table, said in zip(_read_rows(folder, episodes), ours["episodes"], strict=True)
        ]
        return [replace(one, wrench_filter=felt) for one in steps]
    except (ConfigError, KeyError, TypeError, ValueError, OSError, pa.ArrowException) as error:
        raise DatasetError(f"{where} cannot be read as a LeRobot data set: {error}") from error


def _columns(steps: Steps, first: int, episode: int, rate_hz: int) -> dict[str, np.ndarray]:
    """All features of one episode, whose first step is number `first` of the data set."""
    values = to_keys(steps.observations)
    frame = np.arange(len(steps), dtype=np.int64)
    return {
        **{
            feature: np.concatenate([values[key.name] for key in keys], axis=-1)
            for feature, keys in layout.KEYS_OF.items()
        },
        layout.TIME_NS: steps.t,
        layout.ACTION: steps.actions,
        "timestamp": (frame / rate_hz).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.full(len(steps), episode, np.int64),
        "index": first + frame,
        "task_index": np.zeros(len(steps), np.int64),
    }


def _arrow(values: np.ndarray) -> pa.Array:
    if values.ndim == 1:
        return pa.array(values)
    flat = pa.array(np.ascontiguousarray(values).ravel())
    if values.ndim == 2:
        return pa.FixedSizeListArray.from_arrays(flat, values.shape[1])
    # A feature of more dimensions is lists of lists to LeRobot.
    for length in reversed(values.shape[1:]):
        flat = pa.ListArray.from_arrays(np.arange(0, len(flat) + 1, length, dtype=np.int32), flat)
    return flat


def _write_data(folder: Path, episodes: Sequence[Mapping[str, np.ndarray]], task: str) -> list[dict[str, Any]]:
    """Write the data files, a row group an episode, and return the rows of the table of episodes."""
    rows: list[dict[str, Any]] = []
    writer: pq.ParquetWriter | None = None
    file_number, file_bytes = -1, 0
    try:
        for episode, columns in enumerate(episodes):
            table = pa.table({name: _arrow(values) for name, values in columns.items()})
            if writer is None or file_bytes + table.nbytes > layout.FILE_MB * 2**20:
                if writer is not None:
                    writer.close()
                file_number, file_bytes = file_number + 1, 0
                path = folder / layout.data_path(file_number)
                path.parent.mkdir(parents=True, exist_ok=True)
                writer = pq.ParquetWriter(path, table.schema, compression="zstd")
            writer.write_table(table, row_group_size=len(table))
            file_bytes += table.nbytes
            rows.append(_episode_row(columns, episode, file_number, task))
    finally:
        if writer is not None:
            writer.close()
    return rows


def _episode_row(columns: Mapping[str, np.ndarray], episode: int, file_number: int, task: str) -> dict[str, Any]:
    index = columns["index"]
    return {
        "episode_index": episode,
        "tasks": [task],
        "length": len(index),
        "data/chunk_index": file_number // layout.CHUNK_FILES,
        "data/file_index": file_number % layout.CHUNK_FILES,
        "dataset_from_index": int(index[0]),
        "dataset_to_index": int(index[-1]) + 1,
        **{
            f"stats/{feature}/{name}": value.tolist()
            for feature, values in columns.items()
            for name, value in summarise(values).items()
        },
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }


def _statistics(episodes: Sequence[Mapping[str, np.ndarray]]) -> dict[str, dict[str, list[float]]]:
    """`meta/stats.json`: of every feature over all episodes."""
    everything = {feature: np.concatenate([columns[feature] for columns in episodes]) for feature in episodes[0]}
    return {
        feature: {name: value.tolist() for name, value in summarise(values).items()}
        for feature, values in everything.items()
    }


def _read_rows(folder: Path, episodes: Sequence[Mapping[str, Any]]) -> list[pa.Table]:
    """The rows of each episode."""
    places = [(episode["data/chunk_index"], episode["data/file_index"]) for episode in episodes]
    files = [folder / layout.DATA.format(chunk_index=chunk, file_index=file) for chunk, file in dict.fromkeys(places)]
    rows = pa.concat_tables(pq.ParquetFile(file).read() for file in files)
    tables = []
    for i, episode in enumerate(episodes):
        table = rows.slice(episode["dataset_from_index"], episode["length"])
        if len(table) != episode["length"] or table["episode_index"].unique().to_pylist() != [i]:
            raise DatasetError(f"'{folder}': the data files do not hold the {episode['length']} rows of episode {i}.")
        tables.append(table)
    if sum(len(table) for table in tables) != len(rows):
        raise DatasetError(f"'{folder}': the data files hold {len(rows)} rows, which is more than the episodes have.")
    return tables


def _read_steps(table: pa.Table, said: Mapping[str, Any], period_ns: int, where: str) -> Steps:
    t = table[layout.TIME_NS].to_numpy()
    if t.dtype != np.int64 or (np.diff(t) != period_ns).any():
        raise DatasetError(f"{where}: {layout.TIME_NS} has to be int64 with a step every {period_ns} ns.")
    values: dict[str, np.ndarray] = {}
    for feature, keys in layout.KEYS_OF.items():
        width = sum(len(key.take) for key in keys)
        found = _numbers(table[feature], (len(t), *keys[0].shape[:-1], width), f"{where}: {feature}")
        stops = np.cumsum([len(key.take) for key in keys])
        for key, stop in zip(keys, stops, strict=True):
            values[key.name] = found[..., stop - len(key.take) : stop]
    return Steps(
        episode_id=str(said["id"]),
        t=t,
        period_ns=period_ns,
        observations=from_keys(values),
        actions=_numbers(table[layout.ACTION], (len(t), ACTION_WIDTH), f"{where}: {layout.ACTION}"),
        success=bool(said["success"]),
    )


def _numbers(column: pa.ChunkedArray, shape: tuple[int, ...], what: str) -> np.ndarray:
    flat = column.combine_chunks()
    for length in shape[1:]:
        lengths = pc.call_function("list_value_length", [flat]).unique().to_pylist()
        if lengths != [length]:
            raise DatasetError(f"{what}: expected {length} values a row, got {lengths}.")
        flat = flat.flatten()
    if flat.null_count:
        raise DatasetError(f"{what}: {flat.null_count} values are missing.")
    values = flat.to_numpy().reshape(shape)
    require_values(values, shape, what)
    return values
