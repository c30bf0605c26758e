"""Makes selections: of clean folders by conditions, of several others, and divided into what trains and validates."""

import hashlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq

from wrenchflow.datasets.curation.expression import parse
from wrenchflow.datasets.curation.review import read_review
from wrenchflow.datasets.curation.selection import (
    Entry,
    Selection,
    read_selection,
    require_entries,
    source_of,
)
from wrenchflow.datasets.curation.split_config import SPLITS, SplitConfig
from wrenchflow.errors import ConfigError, DatasetError
from wrenchflow.manifest import read_manifest, sha256_of
from wrenchflow.process.table import PARQUET
from wrenchflow.recording.reader import find_recordings, read_info


def everything(path: Path) -> Selection:
    """All recordings of a clean folder, as they were reviewed, or a selection as it is."""
    if path.suffix == ".json":
        return read_selection(path)
    files = find_recordings(path)
    manifest = read_manifest(path) if (path / "manifest.json").exists() else {}
    review = read_review(path)
    entries, left_out = [], []
    for file in files:
        info = read_info(file)
        result = info.meta.get("result")
        success = result.get("success") if isinstance(result, Mapping) else None
        person = info.meta.get("person")
        profile = person.get("profile") if isinstance(person, Mapping) else None
        entry = Entry(
            folder=str(path),
            file=file.name,
            sha256=sha256_of(file),
            id=info.id,
            task=info.task,
            operator=str(profile or info.meta.get("operator") or ""),
            success=success if isinstance(success, bool) else None,
            raw_sha256=str(manifest.get("inputs", {}).get(file.name, "")),
        )
        said = review.episodes.get(file.name)
        if said is not None and said.sha256 == entry.sha256:
            labels = {"success": True, "failure": False}
            entry = replace(entry, task=said.task or entry.task, success=labels.get(said.label, entry.success))
            if said.label == "unusable":
                left_out.append(replace(entry, reason=f"reviewed as unusable{f': {said.note}' if said.note else ''}"))
                continue
        entries.append(entry)
    return Selection(entries=tuple(entries), left_out=tuple(left_out), sources=(source_of(path),))


def select(selection: Selection, where: str, *, only_success: bool = False) -> Selection:
    """Those recordings of which a condition holds; the others are left out, with the reason.

    Args:
        selection: What there is.
        where: A condition on the quality table and on `operator` and `split`; empty for none.
        only_success: Leave out what did not say that it succeeded.

    Raises:
        ConfigError: If it is no condition.
        DatasetError: If there is no quality table, or nothing is left.
    """
    rows = _rows(selection) if where else {}
    expression = parse(where, _samples(rows)) if where else None
    kept, left_out = [], list(selection.left_out)
    for entry in selection.entries:
        holds = True if expression is None else expression.matches(rows[entry.folder, entry.file])
        if only_success and entry.success is not True:
            left_out.append(replace(entry, reason="not a success"))
        elif holds is None:
            lacking = sorted(name for name in expression.columns if rows[entry.folder, entry.file].get(name) is None)  # pyright: ignore
            left_out.append(replace(entry, reason=f"not assessed: {', '.join(lacking) or where}"))
        elif not holds:
            left_out.append(replace(entry, reason=f"not {where}"))
        else:
            kept.append(entry)
    require_entries(kept, f"'{where}'" if where else "--only-success")
    found = replace(selection, entries=tuple(kept), left_out=tuple(left_out))
    return found.then("select", where=where, only_success=only_success)


def _rows(selection: Selection) -> dict[tuple[str, str], dict[str, Any]]:
    """A row of the quality table for each recording, with what the selection says besides."""
    tables: dict[str, dict[str, dict[str, Any]]] = {}
    for folder in dict.fromkeys(entry.folder for entry in selection.entries):
        path = Path(folder, PARQUET)
        if not path.exists():
            raise DatasetError(f"folder '{folder}' has no {PARQUET}, which `wrenchflow process` writes.")
        tables[folder] = {row["id"]: row for row in pq.read_table(path).to_pylist()}
    found = {}
    for entry in selection.entries:
        row = tables[entry.folder].get(entry.id)
        if row is None:
            raise DatasetError(f"{PARQUET} of '{entry.folder}' has no row of {entry.id}: process the folder anew.")
        said = {name: getattr(entry, name) for name in ("task", "operator", "success", "split")}
        found[entry.folder, entry.file] = {**row, **said}
    return found


def _samples(rows: Mapping[tuple[str, str], Mapping[str, Any]]) -> dict[str, Any]:
    """Of each column a value that is there, by which its kind is known."""
    samples: dict[str, Any] = {}
    for row in rows.values():
        for name, value in row.items():
            samples[name] = value if samples.get(name) is None else samples[name]
    return samples


def masks_by_quality(selection: Selection, masks: Sequence[str]) -> dict[str, frozenset[str]]:
    """Ids of the recordings in each mask.

    Args:
        selection: What there is.
        masks: Each as `NAME=CONDITION`, as `select` has conditions.

    Raises:
        ConfigError: If one is none.
        DatasetError: If there is no quality table.
    """
    if not masks:
        return {}
    rows = _rows(selection)
    ids = {(entry.folder, entry.file): entry.id for entry in selection.entries}
    found: dict[str, frozenset[str]] = {}
    for mask in masks:
        name, equals, condition = mask.partition("=")
        if not equals or not name.strip().isidentifier():
            raise ConfigError(f"mask '{mask}' is none, expected NAME=CONDITION, as in gentle=max_force<10.")
        expression = parse(condition, _samples(rows))
        found[name.strip()] = frozenset(ids[key] for key, row in rows.items() if expression.matches(row))
    return found


def merge(selections: Sequence[Selection]) -> Selection:
    """All recordings of several selections; one that is in two of them is taken once.

    Raises:
        DatasetError: If two different recordings have one id.
    """
    kept: dict[str, Entry] = {}
    by_id: dict[str, Entry] = {}
    twice = 0
    for entry in (entry for selection in selections for entry in selection.entries):
        if entry.sha256 in kept:
            twice += 1
            continue
        if entry.id in by_id:
            other = by_id[entry.id]
            raise DatasetError(
                f"two different recordings have the id {entry.id}: '{other.folder}/{other.file}' and "
                f"'{entry.folder}/{entry.file}'. Ids have to differ in a data set; leave one out with select."
            )
        kept[entry.sha256] = by_id[entry.id] = entry
    require_entries(list(kept.values()), "merge")
    made_by = tuple(step for selection in selections for step in selection.made_by)
    sources = tuple({str(each): each for selection in selections for each in selection.sources}.values())
    others = {each.sha256: each for selection in selections for each in selection.left_out if each.sha256 not in kept}
    left_out = tuple(others.values())
    found = Selection(entries=tuple(kept.values()), left_out=left_out, made_by=made_by, sources=sources)
    return found.then("merge", selections=len(selections), taken_once=twice)


def split(selection: Selection, config: SplitConfig) -> Selection:
    """Divide a selection: what stays together is on one side, and each stratum gives each side its share.

    It is decided by hashes of what a demonstration was made of: neither the order nor the place of files matters.

    Raises:
        DatasetError: If there are fewer groups than sides that want some.
    """
    groups: dict[str, list[Entry]] = {}
    for entry in selection.entries:
        key = entry.operator if config.by == "operator" else entry.demonstration
        groups.setdefault(key, []).append(entry)
    wanted = [name for name in SPLITS if getattr(config, name) > 0.0]
    if len(groups) < len(wanted):
        raise DatasetError(f"there are {len(groups)} groups by {config.by}, expected {len(wanted)} or more to divide.")
    strata: dict[tuple[str, ...], list[str]] = {}
    for key, members in groups.items():
        strata.setdefault(tuple(str(getattr(members[0], name)) for name in config.stratify), []).append(key)
    sides: dict[str, str] = {}
    given: Counter[str] = Counter()
    for stratum in sorted(strata):
        keys = sorted(strata[stratum], key=lambda key: hashlib.sha256(f"{config.seed}:{key}".encode()).digest())
        for key in keys:
            # To the side that lacks most of its share, over all strata: so that small ones add up, too.
            total = sum(given.values()) + 1
            side = max(wanted, key=lambda name: (getattr(config, name) * total - given[name], -wanted.index(name)))
            sides[key], given[side] = side, given[side] + 1
    entries = tuple(
        replace(entry, split=sides[entry.operator if config.by == "operator" else entry.demonstration])
        for entry in selection.entries
    )
    told = {"shares": [config.train, config.valid, config.test], "by": config.by}
    found = replace(selection, entries=entries)
    return found.then("split", **told, stratify=list(config.stratify), seed=config.seed)
