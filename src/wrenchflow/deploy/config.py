"""What a person may set about `deploy`; loads nothing heavy, so that the command line can show it at once."""

from dataclasses import dataclass
from typing import Literal

from wrenchflow.config import require_at_least, require_positive
from wrenchflow.deploy.link import Link
from wrenchflow.sim.config import AttemptConfig


@dataclass(frozen=True, kw_only=True)
class DeployConfig(AttemptConfig):
    """How a policy is deployed in virtual time, and what counts as success.

    Attributes:
        episodes: How many attempts.
        latency_s: From the stamp of an observation until its plan arrives [s], beyond the two ticks of measuring; the
            least there is.
        jitter_s: What comes on top of it: the scale of a half-normal distribution [s].
        loss: Share of plans that never arrive.
        force_limit_n: An attempt whose low-passed force peaks above this is no success [N].
        force_cutoff_hz: Of the second-order low-pass before that peak [Hz].
        wrench_input: `felt`, or `zeroed` to see what the policy does without its sense of force.
        batch: Attempts that one worker runs side by side, with one inference for all.
    """

    episodes: int = 200
    latency_s: float = 0.0
    jitter_s: float = 0.0
    loss: float = 0.0
    force_limit_n: float = 25.0
    force_cutoff_hz: float = 50.0
    wrench_input: Literal["felt", "zeroed"] = "felt"
    batch: int = 25

    def __post_init__(self) -> None:
        super().__post_init__()
        require_at_least(1, batch=self.batch)
        require_positive(force_limit_n=self.force_limit_n, force_cutoff_hz=self.force_cutoff_hz)
        _ = self.link  # It refuses what makes no sense.

    @property
    def link(self) -> Link:
        """The way of a plan from the policy to the arm."""
        return Link(latency_s=self.latency_s, jitter_s=self.jitter_s, loss=self.loss)
