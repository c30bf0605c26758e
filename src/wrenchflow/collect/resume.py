"""To go on with a folder of demonstrations, finished or interrupted, with the configuration that it was begun with."""

import logging
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.demonstration import id_of
from wrenchflow.config import to_mapping
from wrenchflow.errors import OutputError
from wrenchflow.manifest import NAME, is_taken, partial_of, read_json, versions, write_json
from wrenchflow.recording.recording import Recording
from wrenchflow.recording.writer_process import DIED

BEGUN = ".begun.json"  # In a folder that is being written: what it is recorded with.
DISCARDED = "discarded"  # Where attempts go that nobody wants to learn from, and what a crash or a stop left of one.


def require_same(out: Path, config: CollectConfig) -> None:
    """Look whether a folder may be gone on with; nothing is changed.

    Raises:
        OutputError: If it was begun with another configuration, whose differences are named, or holds more already.
        RecordingError: If what it was begun with cannot be read.
    """
    target = out.resolve()
    partial = partial_of(target)
    place = next((path for path in (target / NAME, partial / BEGUN) if path.exists()), None)
    if place is None:
        if is_taken(target) or any(partial.glob("*.mcap*")):
            raise OutputError(f"'{out}' does not say what it was recorded with, so it cannot be gone on with.")
        logging.getLogger("wrenchflow").warning("there is nothing in '%s' to go on with yet: it is begun.", out)
        return
    begun = read_json(place)
    known = dict(_flat(begun.get("config", {})))
    asked = dict(_flat(to_mapping(config)))
    other = [key for key in sorted({*known, *asked}) if key != "episodes" and known.get(key) != asked.get(key)]
    if other:
        told = ", ".join(f"{key} {_said(known.get(key))} (got {_said(asked.get(key))})" for key in other)
        raise OutputError(f"'{out}' was begun with {told}: --resume goes on with the same configuration.")
    there = [index for index in range(_highest(place.parent) + 1) if _path(place.parent, config, index).exists()]
    if there and there[-1] >= config.episodes:
        raise OutputError(
            f"'{out}' holds episode {there[-1]} already, counted from 0: expected --episodes {there[-1] + 1} at least, "
            f"got {config.episodes}."
        )
    if begun.get("versions") != versions():
        logging.getLogger("wrenchflow").warning(
            "'%s' was begun with other versions of packages: what is recorded now may differ in its bits.", out
        )


def begin(folder: Path, config: CollectConfig, *, by_the_clock: bool) -> None:
    """Note in a folder what is recorded in it, and clear away what was left half done.

    Args:
        folder: That is being written.
        config: What it is recorded with.
        by_the_clock: What was left cannot be made again; it is set aside.
    """
    (folder / NAME).unlink(missing_ok=True)
    for left in sorted(folder.glob("*.partial")):
        if by_the_clock:
            set_aside(left)
        else:
            left.unlink()
    write_json(folder / BEGUN, {"config": to_mapping(config), "versions": versions()})


def end(folder: Path) -> None:
    """It is whole: what it is recorded with is in its manifest now."""
    (folder / BEGUN).unlink()


def set_cut_off_aside(folder: Path, config: CollectConfig) -> None:
    """Move recordings whose control process died in mid-attempt: nobody ended these, so they are done again."""
    for path in there_and_missing(folder, config)[0]:
        if Recording(path).info.meta.get("result", {}).get("failure") == DIED:
            set_aside(path)


def set_aside(path: Path) -> Path:
    """Move a recording, or what there is of one, into the folder beside it, under a name that is free."""
    folder = path.parent / DISCARDED
    folder.mkdir(exist_ok=True)
    stem, _, rest = path.name.partition(".")
    number = 1
    while (place := folder / f"{stem}-{number}.{rest}").exists():
        number += 1
    return path.rename(place)


def there_and_missing(folder: Path, config: CollectConfig) -> tuple[list[Path], list[int]]:
    """Recordings that are there, and the numbers of those that are not."""
    paths = {index: _path(folder, config, index) for index in range(config.episodes)}
    there = [path for path in paths.values() if path.exists()]
    return there, [index for index, path in paths.items() if not path.exists()]


def _path(folder: Path, config: CollectConfig, index: int) -> Path:
    return folder / f"{id_of(config, index)}.mcap"


def _highest(folder: Path) -> int:
    numbers = [path.stem.rpartition("-")[2] for path in folder.glob("*.mcap")]
    return max((int(number) for number in numbers if number.isdigit()), default=-1)


def _flat(values: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(values, Mapping):
        for key, value in values.items():
            yield from _flat(value, f"{name}.{key}" if name else str(key))
    else:
        yield name, values


def _said(value: Any) -> str:
    return "none" if value is None else str(value)
