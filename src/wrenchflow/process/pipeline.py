"""The stage `process`: raw recordings to clean ones, with what their force is worth beside them."""

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import replace
from functools import partial
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from wrenchflow.config import to_mapping
from wrenchflow.episode import Episode
from wrenchflow.episodes_map import map_episodes
from wrenchflow.errors import WrenchflowError
from wrenchflow.filtering import CausalLowpass
from wrenchflow.manifest import output_folder, write_manifest
from wrenchflow.process.calibration import bias_window, estimate_bias
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.contact import CONTACT, find_contacts
from wrenchflow.process.filters import causal_wrench, zero_phase_wrench
from wrenchflow.process.quality import Quality, assess
from wrenchflow.process.report import report_page
from wrenchflow.process.stamps import check_even, segments
from wrenchflow.recording.reader import find_recordings, read_episode
from wrenchflow.recording.write import write_episode
from wrenchflow.rig import rig_of
from wrenchflow.signals import WRENCH

QUALITY = "quality.parquet"
REPORT = "report.html"

_SCHEMA = pa.schema(
    [
        ("id", pa.string()),
        ("task", pa.string()),
        ("success", pa.bool_()),
        ("snr", pa.struct([(name, pa.float64()) for name in WRENCH.columns])),
        ("snr_force_db", pa.float64()),
        ("snr_torque_db", pa.float64()),
        ("not_assessed", pa.string()),
        ("max_force", pa.float64()),
        ("smoothness", pa.float64()),
        ("has_contact", pa.bool_()),
        ("contacts", pa.int64()),
        ("contact_fraction", pa.float64()),
        ("bias", pa.list_(pa.float64())),
        ("duration_s", pa.float64()),
        ("samples", pa.int64()),
    ]
)


def process_episode(episode: Episode, config: ProcessConfig) -> tuple[Episode, Quality]:
    """Clean the force of one episode.

    Args:
        episode: With `wrench_raw` (wrench or force), `tcp_pose` and the rig in its metadata. A phase `tare` says where
            the arm rested without contact; without it that is the start.
        config: How.

    Returns:
        The episode with `wrench`, `wrench_zero_phase`, its contacts and `meta["process"]` added, and its figures.

    Raises:
        WrenchflowError: If a stream or the rig is missing, the sampling is uneven, or the bias cannot be told. The
            message begins with the episode.
    """
    try:
        return _process(episode, config)
    except WrenchflowError as error:
        raise type(error)(f"episode {episode.id}: {error}") from error


def _process(episode: Episode, config: ProcessConfig) -> tuple[Episode, Quality]:
    rig = rig_of(episode.meta, "its metadata")
    raw, tcp_pose = episode["wrench_raw"], episode["tcp_pose"]
    start_ns, stop_ns = bias_window(episode, config.bias)
    joints = episode.streams.get("joint_states")
    # Sampling first: whether a window is at rest cannot be told of a stream whose stamps are wrong.
    check_even(raw, rig.sensor.rate_hz, "wrench_raw")
    bias = estimate_bias(raw, tcp_pose, joints, rig, start_ns=start_ns, stop_ns=stop_ns, config=config.bias)
    wrench = causal_wrench(raw, tcp_pose, rig, bias, config.cutoff_hz)
    labels = zero_phase_wrench(raw, tcp_pose, rig, bias, config.cutoff_hz)
    notes = {
        "config": to_mapping(config),
        "bias": bias.to_mapping(),
        "group_delay_s": CausalLowpass(config.cutoff_hz, rig.sensor.rate_hz).group_delay_s,
        "left_out_samples": len(raw) - len(wrench),
        "gaps": max(len(segments(wrench.t, rig.sensor.rate_hz)) - 1, 0),
    }
    others = tuple(event for event in episode.events if event.kind != CONTACT)
    clean = (
        replace(episode, events=others)
        .with_stream("wrench", wrench)
        .with_stream("wrench_zero_phase", labels)
        .with_events(*find_contacts(labels, rig, config.contact))
        .with_meta(process=notes)
    )
    return clean, assess(clean, bias)


def process_folder(
    raw: Path,
    out: Path,
    config: ProcessConfig,
    *,
    jobs: int = 1,
    overwrite: bool = False,
    executor: Executor | None = None,
) -> Iterator[Quality]:
    """Clean every recording of a folder.

    Args:
        raw: Folder of `*.mcap`; it is only read.
        out: Folder that gets the clean recordings, `quality.parquet`, `report.html` and `manifest.json`. It is complete
            once the iterator is exhausted, and does not exist before.
        config: How.
        jobs: Worker processes.
        overwrite: Replace `out` if it is there.
        executor: Used in place of worker processes of its own.

    Yields:
        The figures of each episode, in the order of the names.

    Raises:
        RecordingError: If there is nothing to read.
        OutputError: If `out` is taken, or holds `raw`.
        WrenchflowError: If an episode is refused. No folder that looks whole is left then.
    """
    paths = find_recordings(raw)
    with output_folder(out, overwrite=overwrite, reads=[raw]) as folder:
        qualities = []
        for quality in map_episodes(partial(_process_file, folder, config), paths, jobs=jobs, executor=executor):
            qualities.append(quality)
            yield quality
        pq.write_table(pa.Table.from_pylist([_row(quality) for quality in qualities], _SCHEMA), folder / QUALITY)
        (folder / REPORT).write_text(report_page(qualities, config), encoding="utf-8")
        write_manifest(folder, "process", config, paths)


def _process_file(folder: Path, config: ProcessConfig, path: Path) -> Quality:
    clean, quality = process_episode(read_episode(path), config)
    write_episode(folder / path.name, clean)
    return quality


def _row(quality: Quality) -> dict[str, object]:
    return {name: getattr(quality, name) for name in _SCHEMA.names}
