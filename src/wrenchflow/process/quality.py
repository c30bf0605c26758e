"""What an episode's force is worth: the four basic metrics, and what they rest on."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool

from wrenchflow.episode import Episode
from wrenchflow.process.calibration import Bias
from wrenchflow.process.contact import CONTACT, in_contact

# The filter smears an impact over some 50 ms: what lies that near to a contact is neither free motion nor contact.
GUARD_NS = 50_000_000
MIN_SAMPLES = 100


@dataclass(frozen=True, kw_only=True)
class Quality:
    """Figures of one clean episode.

    Attributes:
        id: The episode.
        task: Its task.
        snr: Contact RMS over free-motion RMS of `wrench_zero_phase`, a value an axis [dB]; None where not assessable.
        snr_force_db: The same of the three forces together; None where not assessable.
        snr_torque_db: The same of the three moments together; None where not assessable.
        not_assessed: Why the SNR (or that of the moments) could not be told; empty if it could.
        max_force: Largest norm of the force in `wrench` [N]: causally low-passed, as deployment's limit sees it.
        smoothness: Mean norm of the change of the force from one sample of `wrench_zero_phase` to the next [N]; lower
            is smoother.
        has_contact: Whether there is any contact.
        contacts: Number of contacts.
        contact_fraction: Share of the samples that lie in a contact.
        bias: Sensor bias, in the columns of the raw stream [N, N.m].
        duration_s: Length of the episode [s].
        samples: Samples of `wrench`.
        success: What the recording says came of it; None where it does not say.
    """

    id: str
    task: str
    snr: Mapping[str, float | None]
    snr_force_db: float | None
    snr_torque_db: float | None
    not_assessed: str
    max_force: float
    smoothness: float
    has_contact: bool
    contacts: int
    contact_fraction: float
    bias: tuple[float, ...]
    duration_s: float
    samples: int
    success: bool | None


def assess(episode: Episode, bias: Bias) -> Quality:
    """Assess a clean episode.

    Args:
        episode: With `wrench`, `wrench_zero_phase` and its contacts.
        bias: What was taken out of it.
    """
    wrench, labels = episode["wrench"], episode["wrench_zero_phase"]
    contacts = episode.events_of(CONTACT)
    touching = in_contact(labels, contacts)
    free = ~in_contact(labels, contacts, GUARD_NS)
    columns = labels.signal.columns
    groups = {name: [i] for i, name in enumerate(columns)} | {"force": [0, 1, 2], "torque": [3, 4, 5]}
    reason = _reason(touching, free)
    snr = {
        name: None if reason or axes[-1] >= len(columns) else _snr_db(labels.data[:, axes], touching, free)
        for name, axes in groups.items()
    }
    steps_n = np.linalg.norm(np.diff(labels.data[:, :3], axis=0), axis=1)
    return Quality(
        id=episode.id,
        task=episode.task,
        snr={name: snr[name] for name in columns},
        snr_force_db=snr["force"],
        snr_torque_db=snr["torque"],
        not_assessed=reason or ("" if len(columns) == 6 else "a force sensor reads no moments"),
        max_force=float(np.linalg.norm(wrench.data[:, :3], axis=1).max(initial=0.0)),
        smoothness=float(steps_n.mean()) if len(steps_n) else 0.0,
        has_contact=len(contacts) > 0,
        contacts=len(contacts),
        contact_fraction=float(touching.mean()) if len(touching) else 0.0,
        bias=tuple(bias.mean.tolist()),
        duration_s=episode.duration_s,
        samples=len(wrench),
        success=_success(episode.meta),
    )


def _reason(touching: Bool[np.ndarray, " n"], free: Bool[np.ndarray, " n"]) -> str:
    """Why there is no SNR; empty if there is one."""
    for name, count in (("contact", int(touching.sum())), ("free motion", int(free.sum()))):
        if count < MIN_SAMPLES:
            return f"{count} samples of {name}, {MIN_SAMPLES} needed"
    return ""


def _snr_db(data: np.ndarray, touching: Bool[np.ndarray, " n"], free: Bool[np.ndarray, " n"]) -> float | None:
    signal, noise = (float(np.sqrt((data[rows] ** 2).mean())) for rows in (touching, free))
    return 20.0 * float(np.log10(signal / noise)) if signal > 0.0 and noise > 0.0 else None


def _success(meta: Mapping[str, Any]) -> bool | None:
    result = meta.get("result")
    success = result.get("success") if isinstance(result, Mapping) else None
    return success if isinstance(success, bool) else None
