"""The work that the robot does on its environment, as the sensor and as the joints tell it.

Both are the same energy. Where they differ, the sensor's sign, frame, scale or clock is wrong, or the joints' model is.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.episode import Episode, Stream
from wrenchflow.filtering import zero_phase
from wrenchflow.force_filter import FilterConfig
from wrenchflow.process.finding import NotAssessed
from wrenchflow.process.metrics.figure import Figure, unknown_all
from wrenchflow.process.metrics.force import Felt
from wrenchflow.signals import ARM_JOINTS

ENERGY = ("work_wrench_j", "work_joints_j", "energy_gap")
_LONGEST_S = 0.1  # A longer step has no known power.
_LEAST_J = 0.01  # With less energy to and fro a share of it says nothing.


@dataclass(frozen=True, kw_only=True, eq=False)
class Work:
    """Work done on the environment from the start to each stamp.

    Attributes:
        t: Stamps [ns]. Shape (n,).
        wrench_j: By the sensor [J]. Shape (n,).
        joints_j: By the joints [J]; None without torques that are known. Shape (n,).
        exchanged_j: All that went to and fro, by the sensor [J].
    """

    t: Int64[np.ndarray, " n"]
    wrench_j: Float[np.ndarray, " n"]
    joints_j: Float[np.ndarray, " n"] | None
    exchanged_j: float


def work_of(episode: Episode, felt: Felt, filter: FilterConfig) -> Work | str:
    """Work by both witnesses, or why there is none.

    Args:
        episode: With `tcp_twist`, and `external_torque` and `joint_states` for the joints' side.
        felt: The clean force.
        filter: That made `felt`; the joints' torques are filtered alike.
    """
    twist = episode.streams.get("tcp_twist")
    if twist is None or not len(twist):
        return "there is no stream 'tcp_twist'"
    if felt.labels.signal.width < 6:
        return "a force sensor reads no moments, and their work is unknown"
    if not len(felt.labels):
        return "no sample is left"
    t = felt.labels.t
    seconds = np.diff(t, prepend=t[0]) * 1e-9
    seconds[seconds > _LONGEST_S] = 0.0
    power = np.einsum("ij,ij->i", felt.labels.data, _held(twist, t))
    return Work(
        t=t,
        wrench_j=np.cumsum(power * seconds),
        joints_j=_by_joints(episode, t, seconds, filter),
        exchanged_j=float((np.abs(power) * seconds).sum()),
    )


def _by_joints(
    episode: Episode, t: Int64[np.ndarray, " n"], seconds: Float[np.ndarray, " n"], filter: FilterConfig
) -> Float[np.ndarray, " n"] | None:
    torque, joints = episode.streams.get("external_torque"), episode.streams.get("joint_states")
    if torque is None or joints is None or len(torque) < 2 or not len(joints):
        return None
    count = torque.signal.width
    if joints.signal.width != 3 * count or count != ARM_JOINTS:
        return None
    smooth = torque.data
    if np.isfinite(smooth).all() and filter.cutoff_hz < 0.5 * torque.rate_hz:
        smooth = zero_phase(smooth, filter.cutoff_hz, torque.rate_hz, filter.order)
    tau = _held(Stream(torque.t, smooth, torque.signal, torque.frame), t)
    velocity = _held(joints, t)[:, count : 2 * count]
    return np.cumsum(np.einsum("ij,ij->i", tau, velocity) * seconds)


def _held(stream: Stream, t: Int64[np.ndarray, " n"]) -> Float[np.ndarray, "n d"]:
    """The last row at or before each stamp; the first one before there is any."""
    return stream.data[np.maximum(np.searchsorted(stream.t, t, side="right") - 1, 0)]


def energy_figures(work: Work | str) -> Iterator[Figure]:
    """The balance at the end."""
    if isinstance(work, str):
        yield from unknown_all(ENERGY, work)
        return
    if not np.isfinite(work.wrench_j[-1]):
        yield from unknown_all(ENERGY, "the tcp's twist is not finite throughout")
        return
    yield "work_wrench_j", float(work.wrench_j[-1])
    if work.joints_j is None or not np.isfinite(work.joints_j[-1]):
        yield from unknown_all(ENERGY[1:], "there are no external torques of seven joints")
        return
    yield "work_joints_j", float(work.joints_j[-1])
    if work.exchanged_j < _LEAST_J:
        reason = f"{work.exchanged_j:.2g} J were exchanged, {_LEAST_J:g} J needed"
        yield NotAssessed(kind="energy_gap", reason=reason)
    else:
        yield "energy_gap", float(abs(work.wrench_j[-1] - work.joints_j[-1]) / work.exchanged_j)
