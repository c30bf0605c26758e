"""Jumps: a force that changes faster than stiffness times speed lets it, and stays."""

from collections.abc import Iterator

import numpy as np

from wrenchflow.process.anomalies.look import HALF, Look
from wrenchflow.process.finding import Finding
from wrenchflow.running_median import centred_median

KIND = "jump"
STIFFEST_N_M = 2e6  # A steel tool on steel, gripper and arm included, is softer.
_SIGMAS = 12.0
_AFTER = 3 * HALF


def find_jumps(look: Look) -> Iterator[Finding]:
    """Find steps of the force between two samples that no contact makes at the speed that the tool has.

    The step is that of the running median, which follows steps and not spikes. Without a speed nothing is said.
    """
    twist = look.episode.streams.get("tcp_twist")
    if twist is None or len(look.data) < 4 * _AFTER or not len(twist):
        return
    smooth = centred_median(look.data[:, :3], 2 * HALF + 1)
    step_n = np.abs(np.diff(smooth, axis=0))
    # Only what stands out of the noise is worth a look at the speed.
    least_n = _SIGMAS * look.sigma[:3]
    suspects = np.flatnonzero(((step_n > least_n) & (least_n > 0.0)).any(axis=1))
    at = np.clip(np.searchsorted(twist.t, look.t[suspects + 1], side="right") - 1, 0, len(twist) - 1)
    for i, k in zip(suspects.tolist(), at.tolist(), strict=True):
        # The fastest within the median's reach: a blow stops the tool at once.
        near_m_s = np.linalg.norm(twist.data[max(k - _AFTER, 0) : k + _AFTER + 1, :3], axis=1).max()
        possible_n = STIFFEST_N_M * near_m_s * look.period_ns * 1e-9 + least_n
        beyond = (step_n[i] > possible_n) & (least_n > 0.0)
        if not beyond.any():
            continue
        worst = int(np.argmax(step_n[i] / possible_n))
        yield Finding(
            kind=KIND,
            severity="warning",
            start_ns=int(look.t[i]),
            stop_ns=look.stop_ns(i + 1),
            columns=tuple(np.array(look.columns)[:3][beyond].tolist()),
            evidence=f"{step_n[i, worst]:.3g} N in one sample of {look.columns[worst]}, at {near_m_s * 1e3:.2g} mm/s "
            f"{possible_n[worst]:.3g} N are possible",
            samples=1,
        )
