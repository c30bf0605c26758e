"""Jumps: a force that changes faster than stiffness times speed lets it, and stays."""

from collections.abc import Iterator

import numpy as np

from wrenchflow.process.anomalies.look import HALF, Look, running_median
from wrenchflow.process.finding import Finding

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
    smooth = running_median(look.data[:, :3])
    step_n = np.abs(np.diff(smooth, axis=0))
    at = np.clip(np.searchsorted(twist.t, look.t[1:], side="right") - 1, 0, len(twist) - 1)
    speed_m_s = np.linalg.norm(twist.data[:, :3], axis=1)
    # The fastest within the median's reach: a blow stops the tool at once.
    near = np.array([speed_m_s[max(k - _AFTER, 0) : k + _AFTER + 1].max() for k in at])
    possible_n = STIFFEST_N_M * near[:, None] * look.period_ns * 1e-9 + _SIGMAS * look.sigma[:3]
    beyond = (step_n > possible_n) & (look.sigma[:3] > 0)
    for i in np.flatnonzero(beyond.any(axis=1)):
        worst = int(np.argmax(step_n[i] / possible_n[i]))
        yield Finding(
            kind=KIND,
            severity="warning",
            start_ns=int(look.t[i]),
            stop_ns=look.stop_ns(i + 1),
            columns=tuple(np.array(look.columns)[:3][beyond[i]].tolist()),
            evidence=f"{step_n[i, worst]:.3g} N in one sample of {look.columns[worst]}, at {near[i] * 1e3:.2g} mm/s "
            f"{possible_n[i, worst]:.3g} N are possible",
            samples=1,
        )
