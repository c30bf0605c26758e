"""When a tool stood still, as its pose tells."""

from itertools import pairwise

import numpy as np
from jaxtyping import Float, Int

from wrenchflow.episode import Stream
from wrenchflow.errors import CalibrationError
from wrenchflow.process.calibrate_config import RestConfig
from wrenchflow.spatial import log_so3, rotation_of

_LONGEST_NS = 86_400_000_000_000
_Mean = tuple[Float[np.ndarray, " 3"], Float[np.ndarray, "3 3"]]  # Place and orientation.


def still_spans(tcp_pose: Stream, joints: Stream | None, config: RestConfig) -> list[tuple[int, int]]:
    """Start and end [ns] of the spans in which the tool neither moves nor turns, without where it comes to rest.

    Poses are looked at in windows: one is still if the next one's mean place and orientation are as near as speeds that
    count as rest would bring them, and no joint turns in it, where somebody recorded them.

    Raises:
        CalibrationError: If they reach over more than a day.
    """
    if len(tcp_pose) < 2:
        return []
    if tcp_pose.t[-1] - tcp_pose.t[0] > _LONGEST_NS:
        raise CalibrationError(
            f"the poses reach over {(tcp_pose.t[-1] - tcp_pose.t[0]) * 1e-9:.3g} s, expected a day at most: their "
            "stamps may be wrong."
        )
    window_ns = round(config.window_s * 1e9)
    edges_ns = np.arange(tcp_pose.t[0], tcp_pose.t[-1] + window_ns, window_ns)
    rows = np.searchsorted(tcp_pose.t, edges_ns)
    means = [_mean_pose(tcp_pose.data[first:last]) if last > first else None for first, last in pairwise(rows)]
    turns = _turning(joints, edges_ns, config.max_joint_velocity_rad_s)
    spans, begun = [], None
    for i, (here, there) in enumerate(pairwise([*means, None])):
        if not turns[i] and here is not None and there is not None and _is_still(here, there, config):
            begun = i if begun is None else begun
            continue
        if begun is not None:
            # Without the window in which it came to rest, and the one in which it may have begun to move.
            start_ns, stop_ns = int(edges_ns[begun + 1]), int(edges_ns[i])
            if stop_ns - start_ns >= config.min_s * 1e9:
                spans.append((start_ns, stop_ns))
            begun = None
    return spans


def _turning(joints: Stream | None, edges_ns: Int[np.ndarray, " n"], limit_rad_s: float) -> list[bool]:
    """Whether a joint turns in each window."""
    if joints is None:
        return [False] * (len(edges_ns) - 1)
    columns = [i for i, unit in enumerate(joints.signal.units) if unit == "rad/s"]
    is_fast = ~(np.abs(joints.data[:, columns]).max(axis=1) <= limit_rad_s)  # A NaN is no rest.
    return [bool(is_fast[first:last].any()) for first, last in pairwise(np.searchsorted(joints.t, edges_ns))]


def _mean_pose(pose: Float[np.ndarray, "n 7"]) -> _Mean:
    """Mean place and orientation of poses that are close together."""
    return pose[:, :3].mean(axis=0), mean_rotation(rotation_of(pose[:, 3:]))


def mean_rotation(R: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation that is nearest to the mean of some that are close together."""
    u, _, v = np.linalg.svd(R.mean(axis=0))
    return u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v


def _is_still(here: _Mean, there: _Mean, config: RestConfig) -> bool:
    moved_m = float(np.linalg.norm(there[0] - here[0]))
    turned_rad = float(np.linalg.norm(log_so3(here[1].T @ there[1])))
    return moved_m <= config.max_speed_m_s * config.window_s and turned_rad <= config.max_turn_rad_s * config.window_s
