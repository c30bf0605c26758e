"""What deployment asks of a policy, whatever it is made of, and what can be put around one."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Float32

from wrenchflow.force_filter import FilterConfig
from wrenchflow.policy.features import FORCE_GROUPS, Features


@runtime_checkable
class Policy(Protocol):
    """Says where to go from what was seen, for many robots (or simulated episodes) at once."""

    @property
    def features(self) -> Features:
        """What it sees."""
        ...

    @property
    def period_ns(self) -> int:
        """Time between steps [ns]."""
        ...

    @property
    def wrench_filter(self) -> FilterConfig:
        """What the wrench that it learned from went through; what it sees has to go through the same."""
        ...

    @property
    def n_obs_steps(self) -> int:
        """Steps that it sees, the current one last."""
        ...

    @property
    def horizon(self) -> int:
        """Targets that `act` gives for one robot."""
        ...

    @property
    def n_action_steps(self) -> int:
        """Targets to execute before it should be asked again."""
        ...

    def act(
        self,
        observations: Float32[np.ndarray, "B n_obs_steps width"],
        goal_pose: Float[np.ndarray, "B 7"],
        rngs: Sequence[np.random.Generator],
    ) -> Float[np.ndarray, "B horizon 7"]:
        """Where to go.

        Args:
            observations: Features of the last steps of B robots, the current step last.
            goal_pose: Each robot's goal as perceived now, in the base frame.
            rngs: Each robot's own randomness, so that an episode does not depend on its neighbours' draws.

        Returns:
            Target poses in the base frame. Target i is to be reached at t + (i + 1) * period_ns, where t is the stamp
            of the current step.
        """
        ...


@dataclass(frozen=True, eq=False)
class WithoutForceInput:
    """A policy whose wrench reads zero: shows whether it uses force, rather than assumes it."""

    policy: Policy

    @property
    def features(self) -> Features:
        """What the policy sees; its wrench columns are there, and zero."""
        return self.policy.features

    @property
    def period_ns(self) -> int:
        """Time between steps [ns]."""
        return self.policy.period_ns

    @property
    def wrench_filter(self) -> FilterConfig:
        """What the policy's wrench went through."""
        return self.policy.wrench_filter

    @property
    def n_obs_steps(self) -> int:
        """Steps that it sees, the current one last."""
        return self.policy.n_obs_steps

    @property
    def horizon(self) -> int:
        """Targets that `act` gives for one robot."""
        return self.policy.horizon

    @property
    def n_action_steps(self) -> int:
        """Targets to execute before it should be asked again."""
        return self.policy.n_action_steps

    def act(
        self,
        observations: Float32[np.ndarray, "B n_obs_steps width"],
        goal_pose: Float[np.ndarray, "B 7"],
        rngs: Sequence[np.random.Generator],
    ) -> Float[np.ndarray, "B horizon 7"]:
        """Where to go, as `Policy.act`, with the wrench features set to zero before they are normalised."""
        unfelt = observations.copy()
        for group in FORCE_GROUPS:
            unfelt[..., self.features.columns_of(group)] = 0.0
        return self.policy.act(unfelt, goal_pose, rngs)
