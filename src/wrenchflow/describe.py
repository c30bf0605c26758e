"""What a file or a folder of ours holds, for `wrenchflow info`; beside the command line, imported by nothing but it."""

import json
from pathlib import Path
from typing import Any

from wrenchflow.errors import RecordingError

KINDS = "a recording (.mcap), a data set (robomimic .hdf5 or LeRobot folder), or a folder that a stage wrote"

_EXPORTED = ".manifest.json"  # `export` leaves one a format, for a folder may hold several.


def describe(path: Path) -> dict[str, Any]:
    """Plain figures of a recording, a data set, or a folder that a stage wrote.

    Raises:
        RecordingError: If there is nothing at `path`, or nothing of a known kind.
        DatasetError: If it is a data set that cannot be read.
    """
    if not path.exists():
        raise RecordingError(f"'{path}' does not exist. Expected {KINDS}.")
    if path.suffix == ".mcap":
        return _recording(path)
    if path.suffix in (".hdf5", ".h5") or (path / "meta" / "info.json").exists():
        return _dataset(path)
    if (path / "manifest.json").exists():
        return _folder(path)
    exported = [file.name.removesuffix(_EXPORTED) for file in sorted(path.glob("*" + _EXPORTED))]
    if exported:
        return {**_dataset(path), "format": ", ".join(exported)}
    raise RecordingError(f"'{path}' is of no kind that is known here. Expected {KINDS}.")


def _recording(path: Path) -> dict[str, Any]:
    from wrenchflow.recording.reader import read_info

    info = read_info(path)
    return {
        "kind": "recording",
        "id": info.id,
        "task": info.task,
        "duration_s": round(info.duration_s, 3),
        "size_bytes": info.size_bytes,
        "result": info.meta.get("result"),
        "topics": {
            topic.name: {
                "schema": topic.schema,
                "messages": topic.count,
                "rate_hz": None if topic.rate_hz is None else round(topic.rate_hz, 2),
            }
            for topic in info.topics
        },
    }


def _dataset(path: Path) -> dict[str, Any]:
    from wrenchflow.datasets.load import load_steps

    steps = load_steps(path)
    return {
        "kind": "data set",
        "format": "LeRobot v3.0" if path.is_dir() else "robomimic HDF5",
        "episodes": len(steps),
        "steps": sum(len(episode) for episode in steps),
        "rate_hz": round(1e9 / steps[0].period_ns, 3),
        "observations": {name: list(values.shape[1:]) for name, values in steps[0].observations.items()},
        "action_width": steps[0].actions.shape[1],
    }


def _folder(path: Path) -> dict[str, Any]:
    from wrenchflow.manifest import read_manifest

    manifest = read_manifest(path)
    files = sorted(file for file in path.rglob("*") if file.is_file())
    described = {
        "kind": f"folder of {manifest['stage']}",
        "files": len(files),
        "recordings": sum(file.suffix == ".mcap" for file in files),
        "size_bytes": sum(file.stat().st_size for file in files),
        "seed": manifest["seed"],
        "versions": manifest["versions"],
    }
    if (path / "evaluation.json").exists():
        evaluation = json.loads((path / "evaluation.json").read_text())
        described["evaluation"] = {key: value for key, value in evaluation.items() if key != "attempts_by_id"}
    return described
