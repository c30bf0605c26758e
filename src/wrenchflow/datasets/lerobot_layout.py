"""What a LeRobotDataset v3.0 folder is made of: paths, features, and the small files under `meta/`."""

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from wrenchflow.datasets import increments
from wrenchflow.datasets.keys import ACTION_COLUMNS, ACTION_RULE, ACTION_UNITS, Key, keys_of, to_keys
from wrenchflow.observation import ACTION_WIDTH, Steps

FORMAT_VERSION = 2
CODEBASE_VERSION = "v3.0"
STATE = "observation.state"
ENVIRONMENT_STATE = "observation.environment_state"
WINDOW = "observation.wrench_window"
TIME_NS = "observation.time_ns"
ACTION = "action"
# Not `action.*` and not `observation.*`, which LeRobot would hand to a policy.
INCREMENT = "target_increment"
SKEW_NS, VALID = "sync_skew_ns", "sync_valid"

CHUNK_FILES = 1000
FILE_MB = 100
VIDEO_FILE_MB = 200
INFO = "meta/info.json"
OURS = "meta/wrenchflow.json"
OUR_EPISODES = "meta/wrenchflow_episodes.parquet"
EPISODES = "meta/episodes/chunk-000/file-000.parquet"
DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"


def _feature_of(key: Key) -> str:
    if key.observation == "goal_pose":
        return ENVIRONMENT_STATE
    return WINDOW if key.observation == "wrench_window" else STATE


def features_of(keys: Iterable[Key]) -> dict[str, tuple[Key, ...]]:
    """The features that carry observations, and the keys that make up each."""
    found: dict[str, tuple[Key, ...]] = {}
    for key in keys:
        found[_feature_of(key)] = (*found.get(_feature_of(key), ()), key)
    return found


def place(file_number: int) -> dict[str, int]:
    """Chunk and number of a file, as paths and the table of episodes have them."""
    return {"chunk_index": file_number // CHUNK_FILES, "file_index": file_number % CHUNK_FILES}


def data_path(file_number: int) -> str:
    """Path of a data file in the folder."""
    return DATA.format(**place(file_number))


def video_feature(camera: str) -> str:
    """Name of a camera's feature."""
    return f"observation.images.{camera}"


def columns(steps: Steps, first: int, episode: int, task: int, rate_hz: int) -> dict[str, np.ndarray]:
    """All features of an episode that are numbers.

    Args:
        steps: The episode.
        first: Number of its first step in the data set.
        episode: Its number.
        task: The number of its task.
        rate_hz: LeRobot's frames a second.
    """
    values = to_keys(steps.observations)
    frame = np.arange(len(steps), dtype=np.int64)
    sync = {SKEW_NS: steps.skew_ns, VALID: steps.valid} if steps.skew_ns else {}
    return {
        **{
            feature: np.concatenate([values[key.name] for key in keys], axis=-1)
            for feature, keys in features_of(keys_of(steps.observations)).items()
        },
        TIME_NS: steps.t,
        ACTION: steps.actions,
        INCREMENT: increments.increments(steps.observations["tcp_pose"], steps.actions),
        # A feature of one number is plain numbers to LeRobot.
        **{name: np.stack([*of.values()], axis=1)[:, 0 if len(of) == 1 else slice(None)] for name, of in sync.items()},
        "timestamp": (frame / rate_hz).astype(np.float32),
        "frame_index": frame,
        "episode_index": np.full(len(steps), episode, np.int64),
        "index": first + frame,
        "task_index": np.full(len(steps), task, np.int64),
    }


def tasks_table(tasks: Sequence[str]) -> pa.Table:
    """`meta/tasks.parquet`: the tasks, in the order of their numbers."""
    # LeRobot looks a task up by the index of a pandas table, which is a column that the schema's metadata names.
    table = pa.table({"task_index": pa.array(range(len(tasks)), pa.int64()), "task": pa.array(tasks, pa.string())})
    described = [
        {"name": name, "field_name": name, "pandas_type": kind, "numpy_type": numpy_kind, "metadata": None}
        for name, kind, numpy_kind in (("task_index", "int64", "int64"), ("task", "unicode", "object"))
    ]
    description = {"index_columns": ["task"], "column_indexes": [], "columns": described, "pandas_version": "2.0.0"}
    return table.replace_schema_metadata({"pandas": json.dumps(description)})


def info(
    first: Steps, rate_hz: int, *, episodes: int, steps: int, tasks: int, videos: Mapping[str, Mapping[str, Any]]
) -> dict[str, Any]:
    """`meta/info.json`, with its keys in LeRobot's order.

    Args:
        first: An episode; all have its streams and cameras.
        rate_hz: LeRobot's frames a second.
        episodes: How many there are.
        steps: How many in all of them.
        tasks: How many different tasks.
        videos: What is known of each camera's video, by feature.
    """
    features: dict[str, Any] = {}
    for feature, keys in features_of(keys_of(first.observations)).items():
        width, *lengths = sum(len(key.take) for key in keys), *keys[0].shape[:-1]
        names = [f"{key.name}.{column}" for key in keys for column in key.columns]
        features[feature] = _feature("float32", width, names)
        if lengths:
            features[feature] |= {"shape": [*lengths, width], "names": ["sample", "component"]}
    features |= videos
    features[TIME_NS] = _feature("int64", 1, None)
    features[ACTION] = _feature("float32", ACTION_WIDTH, list(ACTION_COLUMNS))
    features[INCREMENT] = _feature("float32", increments.WIDTH, list(increments.COLUMNS))
    if first.skew_ns:
        features[SKEW_NS] = _feature("int64", len(first.skew_ns), list(first.skew_ns))
        features[VALID] = _feature("bool", len(first.valid), list(first.valid))
    features["timestamp"] = _feature("float32", 1, None)
    features |= {name: _feature("int64", 1, None) for name in ("frame_index", "episode_index", "index", "task_index")}
    return {
        "codebase_version": CODEBASE_VERSION,
        "fps": rate_hz,
        "features": features,
        "total_episodes": episodes,
        "total_frames": steps,
        "total_tasks": tasks,
        "chunks_size": CHUNK_FILES,
        "data_files_size_in_mb": FILE_MB,
        "video_files_size_in_mb": VIDEO_FILE_MB,
        "data_path": DATA,
        "video_path": VIDEO if videos else None,
        "robot_type": None,
        "splits": {"train": f"0:{episodes}"},
    }


def _feature(dtype: str, width: int, names: list[str] | None) -> dict[str, Any]:
    return {"dtype": dtype, "shape": [width], "names": names}


def ours(first: Steps, described: Mapping[str, Any], masks: Mapping[str, Sequence[int]]) -> dict[str, Any]:
    """`meta/wrenchflow.json`: what LeRobot has no place for; ids and the like are in a table beside it."""
    features = features_of(keys_of(first.observations))
    return {
        "format": FORMAT_VERSION,
        **described,
        "units": {feature: [unit for key in keys for unit in key.units] for feature, keys in features.items()}
        | {ACTION: list(ACTION_UNITS), INCREMENT: list(increments.UNITS)},
        "action_rule": ACTION_RULE,
        "increment_rule": increments.RULE,
        "quaternion_order": "xyzw",
        "masks": {name: list(members) for name, members in masks.items()},
    }
