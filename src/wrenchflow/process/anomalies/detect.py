"""All detectors, by what they find, over one recording."""

from collections.abc import Callable, Iterator

import numpy as np

from wrenchflow.episode import Episode
from wrenchflow.process.anomalies.arm_force import arm_force
from wrenchflow.process.anomalies.consistency import find_inconsistency
from wrenchflow.process.anomalies.duplicates import KIND as DUPLICATE
from wrenchflow.process.anomalies.duplicates import find_duplicates
from wrenchflow.process.anomalies.implausible import KIND as IMPLAUSIBLE
from wrenchflow.process.anomalies.implausible import find_implausible
from wrenchflow.process.anomalies.jumps import KIND as JUMP
from wrenchflow.process.anomalies.jumps import find_jumps
from wrenchflow.process.anomalies.look import Look
from wrenchflow.process.anomalies.quaternions import find_quaternion_flips
from wrenchflow.process.anomalies.saturation import KIND as SATURATION
from wrenchflow.process.anomalies.saturation import find_saturation
from wrenchflow.process.anomalies.spikes import KIND as SPIKE
from wrenchflow.process.anomalies.spikes import find_spikes
from wrenchflow.process.anomalies.stuck import CONSTANT, REPEATED, find_stuck
from wrenchflow.process.anomalies.timing import find_dropouts, find_not_finite, find_unevenness
from wrenchflow.process.anomalies.vibration import find_vibration
from wrenchflow.process.finding import Finding, NotAssessed
from wrenchflow.process.stamps import finite
from wrenchflow.rig import Rig

DETECTORS: tuple[Callable[[Look], Iterator[Finding]], ...] = (
    find_dropouts,
    find_unevenness,
    find_stuck,
    find_implausible,
    find_saturation,
    find_spikes,
    find_vibration,
    find_duplicates,
    find_jumps,
    find_quaternion_flips,
)
# Whoever compares forces would find more of the same.
_SPOILING = (DUPLICATE, SATURATION, CONSTANT, IMPLAUSIBLE, JUMP)
# What else shows in the same columns where a reading is not what it is said to be, or is held.
_FOLLOWING = {DUPLICATE: (SATURATION, IMPLAUSIBLE, JUMP), IMPLAUSIBLE: (JUMP, SATURATION), REPEATED: (SPIKE,)}


def detect(episode: Episode, rig: Rig, free: np.ndarray) -> tuple[list[Finding], list[NotAssessed]]:
    """Run every detector.

    Args:
        episode: With `wrench_raw`.
        rig: The robot cell.
        free: Whether each finite sample of `wrench_raw` lies in free motion. Shape (n,).

    Returns:
        What was found, by time; and what could not be looked for.
    """
    raw = episode["wrench_raw"]
    look = Look(episode=episode, raw=finite(raw), rig=rig, free=free)
    found: list[Finding | NotAssessed] = list(find_not_finite(raw, look.period_ns))
    for find in DETECTORS:
        found += find(look)
    found = [each for each in found if not _follows(each, found)]
    spoilt = sorted({each.kind for each in found if isinstance(each, Finding) and each.kind in _SPOILING})
    witness = f"a reading with the finding '{spoilt[0]}' cannot be compared" if spoilt else arm_force(look)
    found += find_inconsistency(look, witness)
    findings = sorted(
        (each for each in found if isinstance(each, Finding)), key=lambda each: (each.start_ns, each.kind)
    )
    return findings, [each for each in found if isinstance(each, NotAssessed)]


def _follows(one: Finding | NotAssessed, found: list[Finding | NotAssessed]) -> bool:
    """Whether a finding only follows from another one in a column of its own."""
    return isinstance(one, Finding) and any(
        one.kind in _FOLLOWING.get(other.kind, ()) and (not other.columns or set(one.columns) & set(other.columns))
        for other in found
        if isinstance(other, Finding)
    )
