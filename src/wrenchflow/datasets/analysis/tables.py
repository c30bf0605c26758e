"""An analysis for programs: Parquet tables whose columns carry their unit and meaning, and a summary."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from wrenchflow.datasets.analysis.analysis import Analysis
from wrenchflow.datasets.analysis.figures import FIGURES
from wrenchflow.datasets.analysis.totals import GROUPS
from wrenchflow.manifest import write_json

EPISODES, GROUPED, AXES, FINDINGS = "episodes.parquet", "groups.parquet", "axes.parquet", "findings.parquet"
LEFT_OUT, TWINS, SPREADS = "left_out.parquet", "duplicates.parquet", "collectors.parquet"
RELEVANCE, RELEVANT, SUMMARY = "relevance.parquet", "relevant.txt", "analysis.json"
QUANTILES = (0.01, 0.1, 0.5, 0.9, 0.99)
_BATCH = 10_000


def write_tables(folder: Path, analysis: Analysis) -> None:
    """Write all of them.

    Args:
        folder: Where to.
        analysis: What is known.
    """
    episodes = analysis.totals.episodes
    _write(folder / EPISODES, _EPISODES, _episode_rows(analysis))
    _write(folder / GROUPED, _GROUPS, _group_rows(analysis))
    _write(folder / AXES, _AXES, _axis_rows(analysis))
    found = [
        {"kind": one.kind.name, "is_defect": one.kind.is_defect, "id": episodes[i].id, "place": episodes[i].place}
        | {"figure": one.kind.figure, "value": float(episodes[i].values[one.kind.figure] or 0.0)}
        for one in analysis.findings
        for i in one.episodes
    ]
    _write(folder / FINDINGS, _FINDINGS, found)
    left_out = [{"place": place, "reason": reason} for place, reason in analysis.totals.left_out]
    _write(folder / LEFT_OUT, _LEFT_OUT, left_out)
    twins = [
        {"first": episodes[one.first].id, "second": episodes[one.second].id, "apart": one.apart, "of": one.of}
        for one in analysis.twins
    ]
    _write(folder / TWINS, _TWINS, twins)
    spread = [
        {"task": one.task, "figure": one.figure, "collectors": one.collectors, "episodes": one.episodes}
        | {"between": one.between, "within": one.within, "ratio": one.ratio}
        for one in analysis.spreads
    ]
    _write(folder / SPREADS, _SPREADS, spread)
    if analysis.config.task:
        ranked = [
            {
                "id": episodes[one.episode].id,
                "place": episodes[one.episode].place,
                "task": episodes[one.episode].labels.task,
            }
            | {"score": one.score, "is_taken": one.is_taken, "why": one.why}
            for one in analysis.relevance
        ]
        _write(folder / RELEVANCE, _RELEVANCE, ranked)
        taken = [episodes[one.episode].place for one in analysis.relevance if one.is_taken]
        (folder / RELEVANT).write_text("".join(f"{place}\n" for place in taken))
    write_json(folder / SUMMARY, summary(analysis))


def summary(analysis: Analysis) -> dict[str, Any]:
    """The few figures that `analyze` prints."""
    totals = analysis.totals
    seconds = analysis.values("duration_s")
    known = [each.labels.success for each in totals.episodes if each.labels.success is not None]
    told: dict[str, Any] = {
        "kind": analysis.kind,
        "episodes": len(totals.episodes),
        "left_out": len(totals.left_out),
        "steps": int(analysis.values("steps").sum()),
        "hours": round(float(seconds.sum()) / 3600.0, 3),
        "successes": sum(known) if known else None,
        "tasks": sum(group.kind == "task" for group in analysis.groups),
        "labs": sum(group.kind == "lab" for group in analysis.groups),
        "collectors": sum(group.kind == "collector" for group in analysis.groups),
        "scenes": sum(group.kind == "scene" for group in analysis.groups),
        "felt": sorted({named[0] for named, _ in totals.tables()} - {"action", "state", "timing"}),
        "with_defects": len(analysis.defective),
        "findings": {one.kind.name: len(one.episodes) for one in analysis.findings},
        "near_duplicates": len(analysis.twins),
    }
    for figure in ("contact_rate", "estimated_contact_rate"):
        if len(rates := analysis.values(figure)):
            told[figure] = round(float(rates.mean()), 4)
    if analysis.config.task:
        told["relevant"] = sum(one.is_taken for one in analysis.relevance)
    return told


def _field(name: str, type: pa.DataType, meaning: str, unit: str = "") -> pa.Field:
    return pa.field(name, type, metadata={"meaning": meaning, "unit": unit})


_TEXT, _NUMBER, _COUNT, _FLAG = pa.string(), pa.float64(), pa.int64(), pa.bool_()
_EPISODES = pa.schema(
    [
        _field("id", _TEXT, "The episode."),
        _field("place", _TEXT, "Where it is in the data set."),
        *(
            _field(kind, _FLAG if kind == "success" else _TEXT, f"Its {kind}; empty where nobody says.")
            for kind in GROUPS
        ),
        *(_field(each.name, _COUNT if each.whole else _NUMBER, each.meaning, each.unit) for each in FIGURES),
        _field("missing", pa.list_(_TEXT), "What it should have and has not."),
    ]
)
_GROUPS = pa.schema(
    [
        _field("kind", _TEXT, "What the episodes have in common."),
        _field("group", _TEXT, "Which."),
        _field("episodes", _COUNT, "How many there are."),
        _field("success_rate", _NUMBER, "Share of those that say so which succeeded."),
        *(
            _field(f"{each.name}_median", _NUMBER, f"Median over episodes. {each.meaning}", each.unit)
            for each in FIGURES
        ),
    ]
)
_AXES = pa.schema(
    [
        _field("kind", _TEXT, "`all`, or what a group of episodes has in common."),
        _field("group", _TEXT, "Which group."),
        _field("table", _TEXT, "What was measured, or estimated."),
        _field("column", _TEXT, "Which axis of it."),
        _field("unit", _TEXT, "Its unit."),
        _field("count", _COUNT, "Finite values."),
        _field("not_finite", _COUNT, "Values that are not finite, or could not be told."),
        *(_field(name, _NUMBER, f"Of the finite values: {name}.") for name in ("min", "max", "mean", "std")),
        *(
            _field(f"q{round(100 * q):02d}", _NUMBER, f"{q:.0%} lie below; within 1 %; of all episodes only.")
            for q in QUANTILES
        ),
    ]
)
_FINDINGS = pa.schema(
    [
        _field("kind", _TEXT, "What was found."),
        _field("is_defect", _FLAG, "Whether it decides against the episode."),
        _field("id", _TEXT, "The episode."),
        _field("place", _TEXT, "Where it is."),
        _field("figure", _TEXT, "The figure that shows it."),
        _field("value", _NUMBER, "The figure's value."),
    ]
)
_LEFT_OUT = pa.schema([_field("place", _TEXT, "Where it is."), _field("reason", _TEXT, "Why it was not looked at.")])
_TWINS = pa.schema(
    [
        _field("first", _TEXT, "An episode."),
        _field("second", _TEXT, "Another that is nearly the same."),
        _field("apart", _NUMBER, "Root mean square distance of their postures.", "rad or m"),
        _field("of", _TEXT, "What was compared."),
    ]
)
_SPREADS = pa.schema(
    [
        _field("task", _TEXT, "The task."),
        _field("figure", _TEXT, "What was compared."),
        _field("collectors", _COUNT, "Collectors with three episodes or more."),
        _field("episodes", _COUNT, "Their episodes."),
        _field("between", _NUMBER, "Standard deviation between collectors."),
        _field("within", _NUMBER, "Standard deviation of one collector's episodes."),
        _field("ratio", _NUMBER, "Between by within."),
    ]
)
_RELEVANCE = pa.schema(
    [
        _field("id", _TEXT, "The episode."),
        _field("place", _TEXT, "Where it is."),
        _field("task", _TEXT, "Its task."),
        _field("score", _NUMBER, "How much of the wanted task's words it shares."),
        _field("is_taken", _FLAG, "Whether it is suggested."),
        _field("why", _TEXT, "Why, or why not."),
    ]
)


def _write(path: Path, schema: pa.Schema, rows: Iterable[dict[str, Any]]) -> None:
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        batch: list[dict[str, Any]] = []
        for row in rows:
            batch.append(row)
            if len(batch) == _BATCH:
                writer.write_table(pa.Table.from_pylist(batch, schema))
                batch = []
        writer.write_table(pa.Table.from_pylist(batch, schema))


def _episode_rows(analysis: Analysis) -> Iterable[dict[str, Any]]:
    for each in analysis.totals.episodes:
        yield {
            "id": each.id,
            "place": each.place,
            **{kind: getattr(each.labels, kind) for kind in GROUPS},
            **{figure.name: each.values.get(figure.name) for figure in FIGURES},
            "missing": list(each.missing),
        }


def _group_rows(analysis: Analysis) -> Iterable[dict[str, Any]]:
    for group in analysis.groups:
        row: dict[str, Any] = {"kind": group.kind, "group": group.name, "episodes": len(group.episodes)}
        row["success_rate"] = success_rate(analysis, group.episodes)
        for figure in FIGURES:
            values = analysis.values(figure.name, group.episodes)
            row[f"{figure.name}_median"] = float(np.median(values)) if len(values) else None
        yield row


def success_rate(analysis: Analysis, episodes: Sequence[int]) -> float | None:
    """Share of some episodes that succeeded, of those that say what came of them; None where none does."""
    said = [analysis.totals.episodes[i].labels.success for i in episodes]
    known = [one for one in said if one is not None]
    return sum(known) / len(known) if known else None


def _axis_rows(analysis: Analysis) -> Iterable[dict[str, Any]]:
    everything = [
        ("all", "", named, of, {q: of.quantile(q) for q in QUANTILES}) for named, of in analysis.totals.tables()
    ]
    grouped = [(*each, {}) for each in analysis.totals.grouped()]
    for kind, group, (table, columns, units), of, quantiles in [*everything, *grouped]:
        for i, (column, unit) in enumerate(zip(columns, units, strict=True)):
            row = {"kind": kind, "group": group, "table": table, "column": column, "unit": unit}
            row |= {"count": int(of.count[i]), "not_finite": int(of.missing[i])}
            told = {"min": of.low[i], "max": of.high[i], "mean": of.mean[i], "std": of.std[i]}
            told |= {f"q{round(100 * q):02d}": found[i] for q, found in quantiles.items()}
            yield row | {name: float(value) if np.isfinite(value) else None for name, value in told.items()}
