"""What a LeRobotDataset v3.0 folder is made of: paths, features, and the small files under `meta/`."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import pyarrow as pa

from wrenchflow.config import to_mapping
from wrenchflow.datasets.keys import ACTION_COLUMNS, ACTION_RULE, ACTION_UNITS, KEYS, About, Key
from wrenchflow.datasets.split import validation_ids
from wrenchflow.observation import ACTION_WIDTH, WINDOW_LENGTH, Steps

FORMAT_VERSION = 1
CODEBASE_VERSION = "v3.0"
STATE = "observation.state"
ENVIRONMENT_STATE = "observation.environment_state"
WINDOW = "observation.wrench_window"
TIME_NS = "observation.time_ns"
ACTION = "action"

CHUNK_FILES = 1000
FILE_MB = 100
INFO = "meta/info.json"
OURS = "meta/wrenchflow.json"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"


def _feature_of(key: Key) -> str:
    if key.observation == "goal_pose":
        return ENVIRONMENT_STATE
    return WINDOW if key.observation == "wrench_window" else STATE


KEYS_OF = {
    feature: tuple(key for key in KEYS if _feature_of(key) == feature) for feature in (STATE, ENVIRONMENT_STATE, WINDOW)
}


def data_path(file_number: int) -> str:
    """Path of a data file in the folder."""
    return DATA.format(chunk_index=file_number // CHUNK_FILES, file_index=file_number % CHUNK_FILES)


def tasks_table(task: str) -> pa.Table:
    """`meta/tasks.parquet`: the one task."""
    # LeRobot looks a task up by the index of a pandas table, which is a column that the schema's metadata names.
    table = pa.table({"task_index": pa.array([0], pa.int64()), "task": pa.array([task])})
    columns = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy_kind, "metadata": None}
        for name, kind, numpy_kind in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    ]
    description = {"index_columns": ["task"], "column_indexes": [], "columns": columns, "pandas_version": "2.0.0"}
    return table.replace_schema_metadata({"pandas": json.dumps(description)})


def info(steps: Sequence[Steps], rate_hz: int) -> dict[str, Any]:
    """`meta/info.json`, with its keys in LeRobot's order."""
    features: dict[str, Any] = {
        feature: _feature("float32", sum(len(key.take) for key in KEYS_OF[feature]), _names(feature))
        for feature in (STATE, ENVIRONMENT_STATE)
    }
    features[WINDOW] = {
        "dtype": "float32",
        "shape": [WINDOW_LENGTH, len(KEYS_OF[WINDOW][0].take)],
        "names": ["sample", "component"],
    }
    features[TIME_NS] = _feature("int64", 1, None)
    features[ACTION] = _feature("float32", ACTION_WIDTH, list(ACTION_COLUMNS))
    features["timestamp"] = _feature("float32", 1, None)
    features |= {name: _feature("int64", 1, None) for name in ("frame_index", "episode_index", "index", "task_index")}
    return {
        "codebase_version": CODEBASE_VERSION,
        "fps": rate_hz,
        "features": features,
        "total_episodes": len(steps),
        "total_frames": sum(len(one) for one in steps),
        "total_tasks": 1,
        "chunks_size": CHUNK_FILES,
        "data_files_size_in_mb": FILE_MB,
        "video_files_size_in_mb": 200,
        "data_path": DATA,
        "video_path": None,
        "robot_type": None,
        "splits": {"train": f"0:{len(steps)}"},
    }


def _feature(dtype: str, width: int, names: list[str] | None) -> dict[str, Any]:
    return {"dtype": dtype, "shape": [width], "names": names}


def _names(feature: str) -> list[str]:
    return [f"{key.name}.{column}" for key in KEYS_OF[feature] for column in key.columns]


def ours(steps: Sequence[Steps], about: About, valid_fraction: float) -> dict[str, Any]:
    """`meta/wrenchflow.json`: what LeRobot has no place for."""
    valid = validation_ids([one.episode_id for one in steps], valid_fraction)
    return {
        "format": FORMAT_VERSION,
        "period_ns": steps[0].period_ns,
        "about": asdict(about),
        "wrench_filter": to_mapping(steps[0].wrench_filter),
        "episodes": [
            {"id": one.episode_id, "success": one.success, "split": "valid" if one.episode_id in valid else "train"}
            for one in steps
        ],
        "observations": {
            key.name: {
                "feature": feature,
                "columns": key.columns,
                "units": key.units,
                "frame": key.frame,
                "rule": key.rule,
            }
            for feature, keys in KEYS_OF.items()
            for key in keys
        },
        "action": {"columns": ACTION_COLUMNS, "units": ACTION_UNITS, "rule": ACTION_RULE},
    }
