"""What a file or a folder of ours holds, for `wrenchflow info`; beside the command line, imported by nothing but it."""

import json
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from wrenchflow.errors import RecordingError
from wrenchflow.manifest import NAME, read_json, read_manifest

if TYPE_CHECKING:
    from wrenchflow.recording.info import TopicInfo

KINDS = "a recording (.mcap), a data set (robomimic .hdf5 or LeRobot folder), or a folder that a stage wrote"

_EXPORTED = ".manifest.json"  # `export` leaves one a format, for a folder may hold several.


def describe(path: Path) -> dict[str, Any]:
    """Plain figures of a recording, a data set, or a folder that a stage wrote.

    Raises:
        RecordingError: If there is nothing at `path`, or nothing of a known kind.
        DatasetError: If it is a data set that cannot be read.
        CheckpointError: If it is a run whose policy cannot be loaded.
    """
    if not path.exists():
        raise RecordingError(f"'{path}' does not exist. Expected {KINDS}.")
    if path.suffix in (".mcap", ".rows") or path.name.endswith(".mcap.partial"):
        return _recording(path)
    if path.name == "evaluation.json":
        return {"kind": "evaluation", **_evaluation(path)}
    if path.suffix in (".hdf5", ".h5") or (path / "meta" / "info.json").exists():
        return _dataset(path)
    if (path / NAME).exists():
        return _folder(path)
    exported = [file.name.removesuffix(_EXPORTED) for file in sorted(path.glob("*" + _EXPORTED))]
    if exported:
        return {**_dataset(path), "format": ", ".join(exported)}
    if (path / "policy.json").exists():
        return {"kind": "run", "policy": _policy(path)}
    if path.is_dir() and (recordings := sorted(path.glob("*.mcap"))):
        return {
            "kind": "folder of recordings",
            "recordings": len(recordings),
            "size_bytes": sum(file.stat().st_size for file in recordings),
        }
    stages = {name.parent.name: describe(name.parent) for name in sorted(path.glob(f"*/{NAME}"))}
    if stages:
        return {"kind": "folder of stages", **stages}
    raise RecordingError(f"'{path}' is of no kind that is known here. Expected {KINDS}.")


def _recording(path: Path) -> dict[str, Any]:
    from wrenchflow.recording.reader import read_info

    info = read_info(path)
    names = Counter(topic.name for topic in info.topics)
    return {
        "kind": "recording",
        "id": info.id,
        "task": info.task,
        "duration_s": round(info.duration_s, 3),
        "size_bytes": info.size_bytes,
        "chunks": dict(info.chunks),
        "by": _by(info.meta),
        "result": info.meta.get("result"),
        "safety": info.meta.get("safety"),
        "plans": info.meta.get("plans"),
        "recorded": info.meta.get("recorded"),
        "topics": {
            topic.name if names[topic.name] == 1 else f"{topic.name} ({topic.schema})": _topic(topic)
            for topic in info.topics
        },
        "attachments": {name: asdict(attached) for name, attached in sorted(info.attachments.items())},
    }


def _by(meta: Mapping[str, Any]) -> dict[str, Any]:
    """Who demonstrated, with what, and from which seed; nothing where a recording does not say so as ours do."""
    person, device, seed = meta.get("person"), meta.get("device"), meta.get("seed")
    told = {
        "operator": meta.get("operator"),
        "profile": person.get("profile") if isinstance(person, Mapping) else None,
        "device": device.get("name") if isinstance(device, Mapping) else None,
        "seed": seed[0] if isinstance(seed, list) and seed else seed,
    }
    return {key: value for key, value in told.items() if value is not None}


def _topic(topic: "TopicInfo") -> dict[str, Any]:
    rate_hz, longest_pause_s = topic.rate_hz, topic.longest_pause_s
    return {
        "schema": topic.schema,
        "messages": topic.count,
        "rate_hz": None if rate_hz is None else round(rate_hz, 2),
        "gaps": topic.gaps,
        "longest_pause_s": None if longest_pause_s is None else round(longest_pause_s, 6),
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
    manifest = read_manifest(path)
    files = sorted(file for file in path.rglob("*") if file.is_file())
    described = {
        "kind": f"folder of {manifest['stage']}",
        "files": len(files),
        "recordings": sum(file.suffix == ".mcap" for file in files),
        "size_bytes": sum(file.stat().st_size for file in files),
        **_chosen(manifest["config"]),
        "seed": manifest["seed"],
        "versions": manifest["versions"],
    }
    if (path / "evaluation.json").exists():
        described["evaluation"] = _evaluation(path / "evaluation.json")
    if (path / "policy.json").exists():
        described["policy"] = _policy(path)
    return described


def _chosen(config: Mapping[str, Any]) -> dict[str, Any]:
    """What a person first wants to know of how a folder was made."""
    return {key: config[key] for key in ("task", "operator", "profiles", "rig") if config.get(key)}


def _evaluation(path: Path) -> dict[str, Any]:
    return {key: value for key, value in read_json(path).items() if key != "attempts_by_id"}


def _policy(path: Path) -> dict[str, Any]:
    from wrenchflow.policy.checkpoint import load_policy

    policy = load_policy(path)
    metrics = path / "metrics.jsonl"
    rows = metrics.read_text().splitlines() if metrics.exists() else []
    last = json.loads(rows[-1]) if rows else {}
    return {
        "network": policy.config.network,
        "objective": policy.config.objective,
        "weights": sum(weight.numel() for weight in policy.network.parameters()),
        "sees": list(policy.features.groups),
        "n_obs_steps": policy.n_obs_steps,
        "horizon": policy.config.horizon,
        "rate_hz": round(1e9 / policy.period_ns, 3),
        "updates": last.get("step"),
        "valid_position_error_m": last.get("valid_position_error_m"),
    }
