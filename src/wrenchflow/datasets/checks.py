"""What has to hold of steps before they are written, and of what is read; the formats check little."""

from collections.abc import Sequence

import numpy as np

from wrenchflow.errors import DatasetError
from wrenchflow.observation import ACTION_WIDTH, OBSERVATIONS, Steps


def require_exportable(steps: Sequence[Steps]) -> None:
    """Refuse steps that cannot make one data set.

    Raises:
        DatasetError: If there are none, an episode is empty or there twice, their periods or filters differ, or an
            observation is missing, of another shape or type, or not finite.
    """
    if not steps:
        raise DatasetError("there is no episode to export.")
    seen: set[str] = set()
    for one in steps:
        if one.episode_id in seen:
            raise DatasetError(f"episode {one.episode_id} is there twice; ids have to differ.")
        seen.add(one.episode_id)
        if not len(one):
            raise DatasetError(f"episode {one.episode_id} has no steps.")
        if one.period_ns != steps[0].period_ns:
            raise DatasetError(
                f"episode {one.episode_id} has a step every {one.period_ns} ns, expected {steps[0].period_ns} ns as in "
                f"episode {steps[0].episode_id}."
            )
        if one.wrench_filter != steps[0].wrench_filter:
            raise DatasetError(
                f"episode {one.episode_id} has a wrench through {one.wrench_filter}, expected {steps[0].wrench_filter} "
                f"as in episode {steps[0].episode_id}."
            )
        for name, shape in OBSERVATIONS.items():
            if name not in one.observations:
                raise DatasetError(
                    f"episode {one.episode_id} has no observation '{name}'. It has: {', '.join(one.observations)}."
                )
            require_values(one.observations[name], (len(one), *shape), f"'{name}' of episode {one.episode_id}")
        require_values(one.actions, (len(one), ACTION_WIDTH), f"the actions of episode {one.episode_id}")


def require_values(values: np.ndarray, shape: tuple[int, ...], what: str) -> None:
    """Refuse an array that is not float32, of `shape` and finite."""
    if values.dtype != np.float32 or values.shape != shape:
        raise DatasetError(f"{what}: expected float32 of shape {shape}, got {values.dtype} of shape {values.shape}.")
    if not np.isfinite(values).all():
        row = int(np.argwhere(~np.isfinite(values))[0][0])
        raise DatasetError(f"{what}: the value of step {row} is not finite.")
