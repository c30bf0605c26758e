"""What has to hold of steps before they are written, and of what is read; the formats check little."""

from collections.abc import Iterable, Sequence

import numpy as np

from wrenchflow.datasets.pictures import size_of
from wrenchflow.errors import DatasetError
from wrenchflow.observation import ACTION_WIDTH, OBSERVATIONS, OPTIONAL, Steps


class Admission:
    """Lets episodes into one data set, one by one, and holds what they have to share with the first of them."""

    def __init__(self) -> None:
        self.first: Steps | None = None
        self._ids: set[str] = set()

    def admit(self, parts: Sequence[Steps]) -> None:
        """Let the parts of a recording in, all of them or none.

        Raises:
            DatasetError: If one is empty or there already, if its period, filter, streams or cameras differ from those
                of the first one, or if an observation is missing, of another shape or type, or not finite.
        """
        first = self.first or parts[0]
        ids = [one.episode_id for one in parts]
        for one in parts:
            self._check(one, first)
        if repeated := (self._ids.intersection(ids) or {id for id in ids if ids.count(id) > 1}):
            raise DatasetError(f"episode {min(repeated)} is there twice; ids have to differ.")
        self._ids.update(ids)
        self.first = first

    @staticmethod
    def _check(one: Steps, first: Steps) -> None:
        if not len(one):
            raise DatasetError(f"episode {one.episode_id} has no steps.")
        shared = {
            "a step every": (f"{one.period_ns} ns", f"{first.period_ns} ns"),
            "a wrench through": (one.wrench_filter, first.wrench_filter),
            "pictures of": (_named(one.pictures), _named(first.pictures)),
            "pictures of so many pixels:": (_sizes(one), _sizes(first)),
            "stamps of": (_named(one.skew_ns), _named(first.skew_ns)),
        }
        for what, (got, expected) in shared.items():
            if got != expected:
                raise DatasetError(
                    f"episode {one.episode_id} has {what} {got}, expected {expected} as in episode {first.episode_id}."
                )
        for name, shape in OBSERVATIONS.items():
            if name in OPTIONAL and name not in first.observations:
                continue
            if name not in one.observations:
                raise DatasetError(
                    f"episode {one.episode_id} has no observation '{name}'. It has: {', '.join(one.observations)}."
                )
            require_values(one.observations[name], (len(one), *shape), f"'{name}' of episode {one.episode_id}")
        require_values(one.actions, (len(one), ACTION_WIDTH), f"the actions of episode {one.episode_id}")


def _sizes(steps: Steps) -> str:
    sizes = {name: size_of(pictures[0]) for name, pictures in steps.pictures.items()}
    return ", ".join(f"{name} {width_px} x {height_px}" for name, (width_px, height_px) in sizes.items()) or "none"


def _named(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"


def require_values(values: np.ndarray, shape: tuple[int, ...], what: str) -> None:
    """Refuse an array that is not float32, of `shape` and finite."""
    if values.dtype != np.float32 or values.shape != shape:
        raise DatasetError(f"{what}: expected float32 of shape {shape}, got {values.dtype} of shape {values.shape}.")
    if not np.isfinite(values).all():
        row = int(np.argwhere(~np.isfinite(values))[0][0])
        raise DatasetError(f"{what}: the value of step {row} is not finite.")
