"""Reads a LeRobot folder that wrenchflow wrote."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from wrenchflow.datasets import lerobot_layout as layout
from wrenchflow.datasets.about import filter_said, keys_said
from wrenchflow.datasets.arrow import values_of
from wrenchflow.datasets.checks import require_values
from wrenchflow.datasets.keys import Key, from_keys
from wrenchflow.errors import ConfigError, DatasetError, RecordingError
from wrenchflow.force_filter import FilterConfig
from wrenchflow.manifest import read_json
from wrenchflow.observation import ACTION_WIDTH, Steps


def read(folder: Path) -> list[Steps]:
    """Read and check a folder that `lerobot.writing` made; videos are left where they are.

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
        if info["codebase_version"] != layout.CODEBASE_VERSION or int(ours["format"]) != layout.FORMAT_VERSION:
            raise DatasetError(
                f"{where} is LeRobot {info['codebase_version']}, format {ours['format']}; this wrenchflow reads "
                f"{layout.CODEBASE_VERSION}, format {layout.FORMAT_VERSION}: export it anew."
            )
        episodes = pq.read_table(folder / layout.EPISODES).to_pylist()
        told = pq.read_table(folder / layout.OUR_EPISODES).to_pylist()
        if len(told) != len(episodes):
            raise DatasetError(f"{where} has {len(episodes)} episodes, but {layout.OUR_EPISODES} names {len(told)}.")
        rows = _Rows(
            int(ours["period_ns"]),
            layout.features_of(keys_said(ours, where)),
            tuple(ours["sync"]["streams"]),
            filter_said(ours, where),
        )
        return [
            rows.steps(table, said, f"{where}: episode {said['episode_id']}")
            for table, said in zip(_tables(folder, episodes), told, strict=True)
        ]
    except (ConfigError, KeyError, TypeError, ValueError, OSError, pa.ArrowException) as error:
        raise DatasetError(f"{where} cannot be read as a LeRobot data set: {error}") from error


def _tables(folder: Path, episodes: Sequence[Mapping[str, Any]]) -> list[pa.Table]:
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


class _Rows:
    """Makes steps of the rows of one folder, of which this much is known."""

    def __init__(
        self, period_ns: int, features: Mapping[str, tuple[Key, ...]], streams: tuple[str, ...], felt: FilterConfig
    ) -> None:
        self._period_ns, self._features, self._streams, self._felt = period_ns, features, streams, felt

    def steps(self, table: pa.Table, said: Mapping[str, Any], where: str) -> Steps:
        t = table[layout.TIME_NS].to_numpy()
        if t.dtype != np.int64 or (np.diff(t) <= 0).any():
            raise DatasetError(f"{where}: {layout.TIME_NS} has to be int64 and to increase.")
        values: dict[str, np.ndarray] = {}
        for feature, keys in self._features.items():
            width = sum(len(key.take) for key in keys)
            found = _numbers(table, feature, (len(t), *keys[0].shape[:-1], width), where)
            stops = np.cumsum([len(key.take) for key in keys])
            for key, stop in zip(keys, stops, strict=True):
                values[key.name] = found[..., stop - len(key.take) : stop]
        return Steps(
            episode_id=str(said["episode_id"]),
            t=t,
            period_ns=self._period_ns,
            observations=from_keys(values),
            actions=_numbers(table, layout.ACTION, (len(t), ACTION_WIDTH), where),
            success=bool(said["success"]),
            wrench_filter=self._felt,
            recording_id=str(said["recording_id"]),
            task=str(said["task"]),
            operator=str(said["operator"]),
            skew_ns=self._by_stream(table, layout.SKEW_NS, where),
            valid=self._by_stream(table, layout.VALID, where),
        )

    def _by_stream(self, table: pa.Table, feature: str, where: str) -> Mapping[str, np.ndarray]:
        if not self._streams:
            return {}
        found = values_of(table[feature], f"{where}: {feature}").reshape(len(table), -1)
        if found.shape != (len(table), len(self._streams)):
            raise DatasetError(
                f"{where}: {feature} has shape {found.shape}, expected ({len(table)}, {len(self._streams)}), one "
                "column a stream."
            )
        return {stream: np.ascontiguousarray(found[:, i]) for i, stream in enumerate(self._streams)}


def _numbers(table: pa.Table, feature: str, shape: tuple[int, ...], where: str) -> np.ndarray:
    values = values_of(table[feature], f"{where}: {feature}")
    require_values(values, shape, f"{where}: {feature}")
    return values
