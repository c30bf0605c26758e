"""How much of what an operator does follows from what a policy would see: targets regressed on observations."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from wrenchflow.datasets.sample import to_steps
from wrenchflow.episode import Episode
from wrenchflow.policy.features import WITH_FORCE, Features, encode_actions
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.pipeline import process_episode

RATE_HZ = 50
# How long before an observation the one beside it was made: a policy's step.
BEFORE_STEPS = 2
_FEATURES = Features(WITH_FORCE)
# Moves are small and noisy: a regression that sees exactly learns noise by heart.
_BLUR = 0.2
_WIDTH, _STEPS, _BATCH, _RATE = 96, 800, 256, 5e-3


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """One episode at `RATE_HZ`, in the goal's axes.

    Attributes:
        observed: What a policy would see, and what it saw `BEFORE_STEPS` ago. Shape (T, w).
        position: Of the tool [m]. Shape (T, 3).
        target: At the end of each step [m]. Shape (T, 3).
        phase: What the operator thought to be doing. Shape (T,).
    """

    observed: np.ndarray
    position: np.ndarray
    target: np.ndarray
    phase: np.ndarray


@dataclass(frozen=True, kw_only=True, eq=False)
class Left:
    """What a regression leaves, by axis of the goal.

    Attributes:
        rms_m: Root mean square of what is left [m]. Shape (3,).
        of_m: Root mean square of what there was to explain [m]. Shape (3,).
        steps: How many there were.
    """

    rms_m: np.ndarray
    of_m: np.ndarray
    steps: int

    @property
    def share(self) -> np.ndarray:
        """Of the mean square. Shape (3,)."""
        return (self.rms_m / self.of_m) ** 2

    def __str__(self) -> str:
        left, of = (" ".join(f"{value:5.2f}" for value in values * 1e3) for values in (self.rms_m, self.of_m))
        return f"{left} of {of} mm, share {' '.join(f'{value:.2f}' for value in self.share)}, {self.steps} steps"


def seen_of(episode: Episode) -> Seen:
    """What is seen and asked for at each step."""
    steps = to_steps(process_episode(episode, ProcessConfig())[0], RATE_HZ)
    seen = _FEATURES.encode(steps.observations).astype(float)
    phases = [event for event in episode.events_of("phase") if event.label != "tare"]
    last = np.searchsorted([event.start_ns for event in phases], steps.t, side="right") - 1
    return Seen(
        observed=np.concatenate([seen, np.concatenate([seen[:1]] * BEFORE_STEPS + [seen[:-BEFORE_STEPS]])], axis=1),
        position=seen[:, _FEATURES.columns_of("position")],
        target=encode_actions(steps.actions, steps.observations["goal_pose"])[:, :3].astype(float),
        phase=np.array([phases[max(i, 0)].label for i in last]),
    )


def leads(train: Sequence[Seen], test: Sequence[Seen], ahead: int) -> Mapping[str, Left]:
    """How far the target will lead the tool in `ahead` steps, from what is seen: what is left of it, by phase.

    Under impedance control force and velocity say where the target is now, whoever put it there; so this says how well
    a policy can imitate, and not yet whether the operator keeps something to itself. That is what `moves` asks.
    """
    return _left([_lead(each, ahead) for each in train], [_lead(each, ahead) for each in test])


def moves(train: Sequence[Seen], test: Sequence[Seen], ahead: int) -> Mapping[str, Left]:
    """How the target will move in `ahead` steps, from what is seen and from where it is now: what is left, by phase.

    What a person does for a reason that is seen follows from it; what is left are noise, and whims.
    """
    return _left([_move(each, ahead) for each in train], [_move(each, ahead) for each in test], _BLUR)


type _Rows = tuple[np.ndarray, np.ndarray, np.ndarray]


def _lead(seen: Seen, ahead: int) -> _Rows:
    count = len(seen.target) - ahead + 1
    return seen.observed[:count], seen.target[ahead - 1 :] - seen.position[:count], seen.phase[:count]


def _move(seen: Seen, ahead: int) -> _Rows:
    now = np.concatenate([seen.target[:1], seen.target[:-1]])
    count = len(now) - ahead + 1
    known = np.concatenate([seen.observed, now - seen.position], axis=1)
    return known[:count], seen.target[ahead - 1 :] - now[:count], seen.phase[:count]


def _left(train: Sequence[_Rows], test: Sequence[_Rows], blur: float = 0.0) -> Mapping[str, Left]:
    X, y, _ = (np.concatenate(part) for part in zip(*train, strict=True))
    explain = regress(X, y, blur)
    X, y, phase = (np.concatenate(part) for part in zip(*test, strict=True))
    left = y - explain(X)
    told = {}
    for label in dict.fromkeys(phase):
        of = phase == label
        rms, size = (np.sqrt((values[of] ** 2).mean(0)) for values in (left, y))
        told[str(label)] = Left(rms_m=rms, of_m=size, steps=int(of.sum()))
    return told


def regress(X: np.ndarray, y: np.ndarray, blur: float) -> Callable[[np.ndarray], np.ndarray]:
    """A function that explains y by X: a small network, the same at each call.

    A network bends sharply where a threshold is, as skills have them; its loss is linear for large errors, so that the
    few strokes do not drown the many small corrections.

    Args:
        X: Shape (n, w); columns past twice the width of the features are lengths [m].
        y: Shape (n, d).
        blur: Noise on what is learned from, in standard deviations of each column.
    """
    extra = X.shape[1] - 2 * _FEATURES.width
    floors = np.concatenate([np.tile(_FEATURES.floors, 2), np.full(extra, 1e-3)])
    mean, scale, size = X.mean(0), np.maximum(X.std(0), floors), y.std(0)

    def standard(X: np.ndarray) -> torch.Tensor:
        return torch.tensor(np.clip((X - mean) / scale, -6.0, 6.0), dtype=torch.float32)

    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        net = torch.nn.Sequential(
            torch.nn.Linear(X.shape[1], _WIDTH),
            torch.nn.SiLU(),
            torch.nn.Linear(_WIDTH, _WIDTH),
            torch.nn.SiLU(),
            torch.nn.Linear(_WIDTH, y.shape[1]),
        )
        optimizer = torch.optim.AdamW(net.parameters(), lr=_RATE, weight_decay=1e-2)
        rates = torch.optim.lr_scheduler.OneCycleLR(optimizer, _RATE, total_steps=_STEPS)
        loss = torch.nn.SmoothL1Loss(beta=0.1)
        inputs, outputs = standard(X), torch.tensor(y / size, dtype=torch.float32)
        for _ in range(_STEPS):
            chosen = torch.randint(len(inputs), (_BATCH,))
            optimizer.zero_grad()
            noise = blur * torch.randn(_BATCH, X.shape[1])
            loss(net(inputs[chosen] + noise), outputs[chosen]).backward()
            optimizer.step()
            rates.step()

    def explain(X: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            return net(standard(X)).numpy() * size

    return explain
