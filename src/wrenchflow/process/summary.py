"""What `process` says of a folder in a few lines."""

from collections.abc import Sequence
from typing import Any

from wrenchflow.process.assessment import Assessment


def summarise_quality(assessments: Sequence[Assessment]) -> dict[str, Any]:
    """Plain figures of a folder.

    Args:
        assessments: One an episode.

    Returns:
        Counts, the largest force [N], and each kind of defect and of warning with its episodes and the evidence of the
        first.
    """
    peaks_n = [each["max_force"] for each in assessments if each["max_force"] is not None]
    return {
        "episodes": len(assessments),
        "cleaned": sum(not each.refused for each in assessments),
        "without_defect": sum(each.is_sound for each in assessments),
        "with_contact": sum(bool(each["has_contact"]) for each in assessments),
        "max_force_n": max(peaks_n, default=None),
        "defects": _by_kind(assessments, "defect"),
        "warnings": _by_kind(assessments, "warning"),
    }


def _by_kind(assessments: Sequence[Assessment], severity: str) -> dict[str, dict[str, Any]]:
    kinds: dict[str, dict[str, Any]] = {}
    for assessment in assessments:
        for finding in assessment.findings:
            if finding.severity != severity:
                continue
            known = kinds.setdefault(finding.kind, {"episodes": [], "evidence": finding.evidence})
            if assessment.id not in known["episodes"]:
                known["episodes"].append(assessment.id)
    return kinds
