"""Faults that are planted into a recording: each kind with the smallest size that must be found."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from wrenchflow.episode import Episode, Stream

RAW = "wrench_raw"


def _with(episode: Episode, data: np.ndarray, t: np.ndarray | None = None) -> Episode:
    raw = episode[RAW]
    return episode.with_stream(RAW, replace(raw, t=raw.t if t is None else t, data=data))


def _noise(column: int) -> float:
    return 0.2 if column < 3 else 0.006


def spike(episode: Episode, rng: np.random.Generator) -> Episode:
    """One to three samples off by 20 to 100 times the noise of a column."""
    data = episode[RAW].data.copy()
    column, width = int(rng.integers(0, 6)), int(rng.integers(1, 4))
    at = int(rng.integers(20, len(data) - 20))
    data[at : at + width, column] += rng.choice([-1, 1]) * rng.uniform(20, 100) * _noise(column)
    return _with(episode, data)


def saturation(episode: Episode, rng: np.random.Generator) -> Episode:
    """A column that is cut off where it was for at least 20 samples."""
    data = episode[RAW].data.copy()
    column = int(rng.integers(0, 6))
    limit = np.sort(data[:, column])[-int(rng.integers(40, 200))]
    data[:, column] = np.minimum(data[:, column], limit)
    return _with(episode, data)


def stuck(episode: Episode, rng: np.random.Generator) -> Episode:
    """A column, or all, that stands still for 15 to 300 samples."""
    data = episode[RAW].data.copy()
    columns = slice(None) if rng.random() < 0.5 else slice((c := int(rng.integers(0, 6))), c + 1)
    width = int(rng.integers(15, 300))
    at = int(rng.integers(20, len(data) - width - 20))
    data[at : at + width, columns] = data[at, columns]
    return _with(episode, data)


def dropout(episode: Episode, rng: np.random.Generator) -> Episode:
    """One to a hundred samples that are missing."""
    raw, width = episode[RAW], int(rng.integers(1, 100))
    at = int(rng.integers(20, len(raw) - width - 20))
    keep = np.r_[0:at, at + width : len(raw)]
    return _with(episode, raw.data[keep], raw.t[keep])


def drift(episode: Episode, rng: np.random.Generator) -> Episode:
    """A force that drifts by 0.6 to 3 N over the recording."""
    data = episode[RAW].data.copy()
    data[:, int(rng.integers(0, 3))] += rng.choice([-1, 1]) * rng.uniform(0.6, 3.0) * np.linspace(0, 1, len(data))
    return _with(episode, data)


def duplicate_column(episode: Episode, rng: np.random.Generator) -> Episode:
    """A column that has the values of another."""
    data = episode[RAW].data.copy()
    i, j = rng.choice(6, 2, replace=False)
    data[:, i] = data[:, j]
    return _with(episode, data)


def wrong_sign(episode: Episode, rng: np.random.Generator) -> Episode:
    """Environment on robot, where robot on environment was meant."""
    return _with(episode, -episode[RAW].data)


def wrong_frame(episode: Episode, rng: np.random.Generator) -> Episode:
    """Axes that are turned by a quarter about one of them."""
    axis, sense = int(rng.integers(0, 3)), float(rng.choice([-1, 1]))
    i, j = (k for k in range(3) if k != axis)
    R = np.zeros((3, 3))
    R[axis, axis], R[i, j], R[j, i] = 1.0, -sense, sense
    data = episode[RAW].data
    return _with(episode, np.hstack([data[:, :3] @ R.T, data[:, 3:] @ R.T]))


def wrong_payload(episode: Episode, rng: np.random.Generator) -> Episode:
    """A rig whose payload is off by 50 to 300 g."""
    rig = dict(episode.meta["rig"])
    payload = dict(rig["payload"])
    payload["mass_kg"] += float(rng.uniform(0.05, 0.3))
    return episode.with_meta(rig={**rig, "payload": payload})


def vibration(episode: Episode, rng: np.random.Generator) -> Episode:
    """A tone of 80 to 300 Hz and 1 to 3 N, for 1.6 s at least."""
    data = episode[RAW].data.copy()
    width = int(rng.integers(1600, max(1601, len(data) // 2)))
    at = int(rng.integers(0, len(data) - width))
    tone = np.sin(2 * np.pi * rng.uniform(80, 300) * np.arange(width) * 1e-3)
    data[at : at + width, int(rng.integers(0, 3))] += rng.uniform(1.0, 3.0) * tone
    return _with(episode, data)


def not_finite(episode: Episode, rng: np.random.Generator) -> Episode:
    """One to fifty samples of a column that are no numbers."""
    data = episode[RAW].data.copy()
    at = int(rng.integers(20, len(data) - 70))
    data[at : at + int(rng.integers(1, 50)), int(rng.integers(0, 6))] = np.nan
    return _with(episode, data)


def repeated(episode: Episode, rng: np.random.Generator) -> Episode:
    """A sensor that gives a new value at 3 to 8 of 10 samples only."""
    data = episode[RAW].data.copy()
    fresh = np.floor(np.arange(len(data)) * rng.uniform(0.3, 0.8))
    first = np.unique(fresh, return_index=True)[1]
    return _with(episode, data[first[fresh.astype(int)]])


def jump(episode: Episode, rng: np.random.Generator) -> Episode:
    """A force that is off by 40 to 100 N from a sample on while the tool rests, as of a driver that restarts."""
    data = episode[RAW].data.copy()
    speed = np.linalg.norm(episode["tcp_twist"].data[:, :3], axis=1)
    still = np.flatnonzero(np.convolve(speed, np.ones(101) / 101, "same")[200 : len(data) - 200] < 0.01) + 200
    at = int(rng.choice(still))
    data[at:, int(rng.integers(0, 3))] += rng.choice([-1, 1]) * rng.uniform(40.0, 100.0)
    return _with(episode, data)


def implausible(episode: Episode, rng: np.random.Generator) -> Episode:
    """A column in millinewtons, or of a counter that ran over: 1.6 times the range to a million."""
    data = episode[RAW].data.copy()
    at, width = int(rng.integers(20, len(data) - 320)), int(rng.integers(1, 300))
    data[at : at + width, int(rng.integers(0, 6))] = rng.choice([-1, 1]) * 320.0 * 10 ** rng.uniform(0.0, 3.5)
    return _with(episode, data)


def quaternion_flip(episode: Episode, rng: np.random.Generator) -> Episode:
    """A quaternion that changes its sign from some sample on."""
    pose = episode["tcp_pose"]
    data = pose.data.copy()
    data[int(rng.integers(100, len(data) - 100)) :, 3:] *= -1.0
    return episode.with_stream("tcp_pose", Stream(pose.t, data, pose.signal, pose.frame))


FAULTS: Mapping[str, Callable[[Episode, np.random.Generator], Episode]] = MappingProxyType(
    {
        "spike": spike,
        "saturation": saturation,
        "stuck": stuck,
        "dropout": dropout,
        "drift": drift,
        "duplicate-column": duplicate_column,
        "wrong-sign": wrong_sign,
        "wrong-frame": wrong_frame,
        "wrong-payload": wrong_payload,
        "vibration": vibration,
        "not-finite": not_finite,
        "quaternion-flip": quaternion_flip,
        "repeated": repeated,
        "jump": jump,
        "implausible": implausible,
    }
)
