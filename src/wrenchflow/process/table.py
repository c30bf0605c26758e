"""`quality.parquet` and `quality.json`: what `process` found, for programs."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from wrenchflow.config import to_mapping
from wrenchflow.manifest import write_json
from wrenchflow.process.assessment import Assessment
from wrenchflow.process.data_set import DataSetQuality
from wrenchflow.process.metric import METRICS
from wrenchflow.signals import WRENCH

PARQUET, JSON = "quality.parquet", "quality.json"

_TYPES = {float: pa.float64(), int: pa.int64(), bool: pa.bool_()}
_REASON = pa.struct([("what", pa.string()), ("reason", pa.string())])


def _field(name: str, type: pa.DataType, meaning: str, unit: str = "") -> pa.Field:
    return pa.field(name, type, metadata={"meaning": meaning, "unit": unit})


# One row an episode. Each column carries its meaning and its unit as metadata of the field.
SCHEMA = pa.schema(
    [
        _field("id", pa.string(), "The episode."),
        _field("task", pa.string(), "Its task."),
        _field("success", pa.bool_(), "What the recording says came of it; null where it does not say."),
        _field("refused", pa.string(), "Why there is no clean recording of it; empty if there is one."),
        _field("defects", pa.int64(), "Findings that decide against it."),
        _field("warnings", pa.int64(), "Findings to look at."),
        _field("kinds", pa.list_(pa.string()), "Kinds of its findings, each once."),
        _field("snr", pa.struct([(name, pa.float64()) for name in WRENCH.columns]), "Signal-to-noise by axis.", "dB"),
        _field("bias", pa.list_(pa.float64()), "Unloaded reading of the sensor, by column of wrench_raw.", "N, N.m"),
        *(_field(metric.name, _TYPES[metric.type], metric.meaning, metric.unit) for metric in METRICS),
        _field("not_assessed", pa.list_(_REASON), "What could not be told, and why."),
    ]
)


def write_tables(folder: Path, quality: DataSetQuality) -> None:
    """Write both files.

    Args:
        folder: Where to.
        quality: What was found.
    """
    rows = [_row(each) for each in quality.assessments]
    pq.write_table(pa.Table.from_pylist(rows, SCHEMA), folder / PARQUET)
    write_json(folder / JSON, as_json(quality))


def as_json(quality: DataSetQuality) -> dict[str, Any]:
    """Everything that was found, as plain values."""
    curves = {
        task: {"median_n": curve.median_n.tolist(), "low_n": curve.low_n.tolist(), "high_n": curve.high_n.tolist()}
        | {"distance_n": dict(curve.distance_n)}
        for task, curve in quality.curves.items()
    }
    plain = {
        "metrics": {
            metric.name: {"title": metric.title, "unit": metric.unit, "meaning": metric.meaning} for metric in METRICS
        },
        "episodes": [to_mapping(each) for each in quality.assessments],
        "distributions": {name: to_mapping(each) for name, each in quality.distributions.items()},
        "unusual": [to_mapping(each) for each in quality.unusual],
        "curves": curves,
        "not_assessed": [to_mapping(each) for each in quality.not_assessed],
    }
    return json.loads(json.dumps(plain, allow_nan=False))


def _row(assessment: Assessment) -> dict[str, Any]:
    findings: Sequence[Any] = assessment.findings
    return {
        "id": assessment.id,
        "task": assessment.task,
        "success": assessment.success,
        "refused": assessment.refused,
        "defects": assessment.count("defect"),
        "warnings": assessment.count("warning"),
        "kinds": sorted({each.kind for each in findings}),
        "snr": dict(assessment.snr) or None,
        "bias": list(assessment.bias) or None,
        **{metric.name: assessment[metric.name] for metric in METRICS},
        "not_assessed": [{"what": each.kind, "reason": each.reason} for each in assessment.not_assessed],
    }
