"""The run folder: trains on a data set, and writes what deployment needs and what a person wants to look at."""

import json
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict
from pathlib import Path

from wrenchflow.config import to_mapping
from wrenchflow.datasets.load import load_steps
from wrenchflow.manifest import output_folder, write_json, write_manifest
from wrenchflow.policy.checkpoint import WEIGHTS, load_policy, save
from wrenchflow.train.config import TrainConfig
from wrenchflow.train.loop import Progress, train_policy

METRICS = "metrics.jsonl"
TIMING = "timing.jsonl"
CONFIG = "config.json"


def train_folder(
    dataset: Path, out: Path, config: TrainConfig, *, start: Path | None = None, overwrite: bool = False
) -> Iterator[Progress]:
    """Train on a data set and write a run: weights, policy, config, metrics, manifest.

    Args:
        dataset: What `datasets.load.load_steps` reads.
        out: The run folder.
        config: How to train.
        start: Another run, whose policy is trained on.
        overwrite: Replace a run that is there.

    Yields:
        A row of metrics now and then; the same rows go into `metrics.jsonl`, their times into `timing.jsonl`.

    Raises:
        OutputError: If `out` exists and may not be replaced.
        DatasetError: If the data set cannot be read or trained on.
        CheckpointError: If `start` cannot be loaded, or does not fit the data set or the config.
    """
    known = None if start is None else load_policy(start)
    reads = [dataset] if start is None else [dataset, start]
    with output_folder(out, overwrite=overwrite, reads=reads) as folder:
        write_json(folder / CONFIG, to_mapping(config))
        with (
            closing(train_policy(load_steps(dataset), config, known)) as training,
            (folder / METRICS).open("w", buffering=1) as metrics,
            (folder / TIMING).open("w", buffering=1) as timing,
        ):
            while True:
                try:
                    progress = next(training)
                except StopIteration as end:
                    policy = end.value
                    break
                metrics.write(json.dumps(asdict(progress.metrics)) + "\n")
                # Times differ from run to run: they stay out of the files that the seed determines.
                times = {"step": progress.metrics.step, "update_s": progress.update_s, "data_s": progress.data_s}
                timing.write(json.dumps(times) + "\n")
                yield progress
        save(folder, policy)
        started = [] if start is None else [start / WEIGHTS]
        write_manifest(folder, "train", config, [*_input_files(dataset), *started], config.seed)


def _input_files(dataset: Path) -> list[Path]:
    """The files whose hashes tell one data set from another: an HDF5 file, or else a folder's descriptions."""
    if dataset.is_file():
        return [dataset]
    return sorted(dataset.glob("*.hdf5")) or sorted(dataset.rglob("*.json"))
