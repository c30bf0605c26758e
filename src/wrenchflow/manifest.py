"""Output folders: made under another name, renamed when whole, with a manifest that says what made them."""

import fcntl
import hashlib
import importlib.metadata
import json
import os
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from wrenchflow import __version__
from wrenchflow.config import to_mapping
from wrenchflow.errors import OutputError, RecordingError

KEEP = ".keep"  # In a folder that is being written: what is in it cannot be made again.
NAME = "manifest.json"
_RECORDED_PACKAGES = ("numpy", "scipy", "numba", "mujoco", "mcap", "h5py", "pyarrow", "torch", "diffusers")


def versions() -> dict[str, str]:
    """Versions of wrenchflow and of what its results depend on, where it is installed."""
    found = {"wrenchflow": __version__}
    for package in _RECORDED_PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            continue  # An optional package that this machine does without.
    return found


def sha256_of(path: Path) -> str:
    """Hash of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def write_manifest(
    folder: Path,
    stage: str,
    config: Any,
    inputs: Iterable[Path] | Mapping[str, str] = (),
    seed: int | None = None,
    name: str = NAME,
    **found: Any,
) -> None:
    """Write `manifest.json`: the resolved config, versions, seed and input hashes. No wall time, no host name.

    A folder that several outputs share has a manifest of another `name` for each. What else a stage found out goes
    along under its keyword. Inputs are files, or the hashes of files by name.
    """
    hashes = inputs if isinstance(inputs, Mapping) else {path.name: sha256_of(path) for path in inputs}
    manifest = {
        "stage": stage,
        "config": to_mapping(config),
        "seed": seed,
        "versions": versions(),
        "inputs": dict(sorted(hashes.items())),
        **to_mapping(found),
    }
    write_json(folder / name, manifest)


def read_manifest(folder: Path) -> dict[str, Any]:
    """Read a folder's `manifest.json`.

    Raises:
        RecordingError: If there is none, or it is not JSON.
    """
    return read_json(folder / NAME)


def write_json(path: Path, value: Any) -> None:
    """Write JSON through `<name>.partial`, so that a crash leaves no file that looks whole."""
    partial = path.with_name(path.name + ".partial")
    partial.write_text(json.dumps(value, indent=2, sort_keys=True, allow_nan=False) + "\n")
    os.replace(partial, path)


def read_json(path: Path) -> Any:
    """Read a JSON file, or say in one line why it cannot be read."""
    try:
        return json.loads(path.read_text())
    except FileNotFoundError as error:
        raise RecordingError(f"'{path}' does not exist.") from error
    except (json.JSONDecodeError, UnicodeDecodeError, OSError) as error:
        raise RecordingError(f"'{path}' cannot be read as JSON: {error}") from error


@contextmanager
def output_folder(
    path: Path, *, overwrite: bool = False, resume: bool | None = None, reads: Iterable[Path] = (), mark: str = NAME
) -> Iterator[Path]:
    """Make a folder as `<name>.partial`, and rename it when the block ends well.

    Args:
        path: Where the finished folder goes.
        overwrite: Replace a folder of ours that is there, once the new one is whole; nothing else is ever replaced.
        resume: Go on with what is there, finished or not: a finished folder is a partial one until the block ends. None
            of a stage that cannot, which an error's advice then leaves out.
        reads: What the stage reads, which must not lie in what it replaces.
        mark: A file, relative to the folder, that tells a folder of ours from anybody else's.

    Yields:
        The folder to write into. After an error or Ctrl-C it stays behind under its `.partial` name.

    Raises:
        OutputError: If `path` exists and may not be replaced, cannot be made, or is being written by another run, or if
            an interrupted run left there what cannot be made again, which a file called `KEEP` says.
    """
    target = path.resolve()
    _require_free(path, target, reads)
    if is_taken(target):
        _require_ours(path, target, mark)
        if not (overwrite or resume):
            goes_on = "" if resume is None else "pass --resume to go on with it, "
            raise OutputError(f"output '{path}' exists already. Choose another place, {goes_on}or pass --overwrite.")
    partial = partial_of(target)
    begun = target if resume and target.exists() else partial
    if begun == target and partial.exists():
        raise OutputError(f"both '{path}' and '{partial}' are there, and only one can be gone on with: move one away.")
    with _held(path, begun, overwrite=overwrite, resume=bool(resume)):
        if begun == target:
            os.replace(target, partial)
        yield partial
        (partial / KEEP).unlink(missing_ok=True)
        if target.exists():
            # Set aside, not removed, until the new one stands in its place.
            aside = target.with_name(target.name + ".replaced")
            shutil.rmtree(aside, ignore_errors=True)
            os.replace(target, aside)
            os.replace(partial, target)
            shutil.rmtree(aside)
        else:
            os.replace(partial, target)


def partial_of(path: Path) -> Path:
    """What a folder or file is called until it is whole."""
    return path.with_name(path.name + ".partial")


def is_taken(path: Path) -> bool:
    """Whether there is something at a path that would be lost; an empty folder is nothing."""
    return path.exists() and not (path.is_dir() and not any(path.iterdir()))


def _require_free(path: Path, target: Path, reads: Iterable[Path]) -> None:
    if Path.cwd().is_relative_to(target):
        raise OutputError(f"output '{path}' is the folder that this runs in, or one above it. Choose another place.")
    for read in reads:
        if read.resolve().is_relative_to(target):
            raise OutputError(f"output '{path}' would replace what is read, '{read}'. Choose another place.")


def _require_ours(path: Path, target: Path, mark: str) -> None:
    if not target.is_dir():
        raise OutputError(f"output '{path}' is a file. Choose another place.")
    if not (target / mark).exists():
        raise OutputError(f"output '{path}' is no folder that wrenchflow made: it has no {mark}. Choose another place.")


@contextmanager
def _held(path: Path, partial: Path, *, overwrite: bool, resume: bool) -> Iterator[None]:
    """Make the partial folder anew, or take what is there, and hold it, so that two runs never write into one."""
    try:
        partial.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(partial, os.O_RDONLY)
    except OSError as error:
        raise OutputError(f"output '{path}' cannot be made: {error.strerror}.") from error
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise OutputError(f"output '{path}' is being written by another run. Choose another place.") from error
        if resume:
            yield
            return
        if not overwrite and (partial / KEEP).exists() and any(partial.rglob("*.mcap*")):
            raise OutputError(
                f"'{partial}' holds what an interrupted run recorded, which cannot be recorded again. Pass --resume to "
                "go on with it, move it away, or pass --overwrite."
            )
        for left in partial.iterdir():  # What an earlier run left behind; the folder itself carries the lock.
            if left.is_dir() and not left.is_symlink():
                shutil.rmtree(left)
            else:
                left.unlink()
        yield
    finally:
        os.close(descriptor)
