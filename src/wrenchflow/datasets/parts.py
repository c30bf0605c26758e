"""The parts of an episode that have all that their steps need: what a policy may learn from."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from wrenchflow.observation import Steps
from wrenchflow.process.contact import runs_of


def valid_parts(steps: Steps) -> list[Steps]:
    """An episode without the steps that are marked as not valid, divided where they were."""
    if all(of.all() for of in steps.valid.values()):
        return [steps]
    usable = np.logical_and.reduce(list(steps.valid.values()))
    return [_cut(steps, slice(first, last), f".{i}") for i, (first, last) in enumerate(runs_of(usable, True))]


def _cut(steps: Steps, part: slice, suffix: str) -> Steps:
    def of[T](columns: Mapping[str, T]) -> dict[str, T]:
        return {name: values[part] for name, values in columns.items()}  # pyright: ignore

    return replace(
        steps,
        episode_id=steps.episode_id + suffix,
        t=steps.t[part],
        observations=of(steps.observations),
        actions=steps.actions[part],
        skew_ns=of(steps.skew_ns),
        valid=of(steps.valid),
        pictures=of(steps.pictures),
    )
