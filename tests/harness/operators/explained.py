"""How much of what an operator does follows from what a policy would see: targets regressed on observations."""

from collections.abc import Mapping, Sequence

import numpy as np

from wrenchflow.datasets.grid import to_steps
from wrenchflow.episode import Episode
from wrenchflow.policy.features import WITH_FORCE, Features, encode_actions
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.pipeline import process_episode

_UNITS = 1200  # Random features of the regression.
_RIDGE = 1e-2
_FEATURES = Features(WITH_FORCE)

type Seen = tuple[np.ndarray, np.ndarray, np.ndarray]


def seen_of(episode: Episode) -> Seen:
    """What is seen at each step, then and a step before; how far the target will lead [m]; and the phase.

    All in the goal's axes. Shapes (T, 2 width), (T, 3), (T,).
    """
    steps = to_steps(process_episode(episode, ProcessConfig())[0])
    seen = _FEATURES.encode(steps.observations).astype(float)
    target = encode_actions(steps.actions, steps.observations["goal_pose"])[:, :3].astype(float)
    phases = [event for event in episode.events_of("phase") if event.label != "tare"]
    last = np.searchsorted([event.start_ns for event in phases], steps.t, side="right") - 1
    labels = np.array([phases[max(i, 0)].label for i in last])
    before = np.concatenate([seen[:1], seen[:-1]])
    return np.concatenate([seen, before], axis=1), target - seen[:, _FEATURES.columns_of("position")], labels


def unexplained(train: Sequence[Seen], test: Sequence[Seen]) -> Mapping[str, np.ndarray]:
    """What a regression leaves of the lead on episodes that it has not seen, by phase.

    The regression is ridge on random tanh features, which can follow any smooth function.

    Returns:
        What is left, root mean square, by axis of the goal [m]. Shape (3,).
    """
    rng = np.random.default_rng(0)
    X, y, _ = (np.concatenate(part) for part in zip(*train, strict=True))
    mean, scale = X.mean(0), np.maximum(X.std(0), np.tile(_FEATURES.floors, 2))
    width = X.shape[1]
    into = rng.normal(size=(width, _UNITS)) / np.sqrt(width) * rng.uniform(0.3, 3.0, _UNITS)
    shift = rng.normal(size=_UNITS)

    def lift(X: np.ndarray) -> np.ndarray:
        Z = np.clip((X - mean) / scale, -6.0, 6.0)
        return np.concatenate([np.tanh(Z @ into + shift), Z, np.ones((len(Z), 1))], axis=1)

    A = lift(X)
    weights = np.linalg.solve(A.T @ A + _RIDGE * np.eye(A.shape[1]), A.T @ y)
    X, y, labels = (np.concatenate(part) for part in zip(*test, strict=True))
    left = y - lift(X) @ weights
    told = {}
    for label in dict.fromkeys(labels):
        of = labels == label
        told[str(label)] = np.sqrt((left[of] ** 2).mean(0))
    return told
