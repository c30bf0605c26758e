"""What a person may set about `deploy`; loads nothing heavy, so that the command line can show it at once."""

from dataclasses import dataclass, field
from typing import Literal

from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class DeployConfig:
    """How a policy is deployed in virtual time, and what counts as success.

    Attributes:
        task: Name of the task.
        episodes: How many attempts.
        seed: Every random number of attempt i comes from (seed, i); scenes differ from those of `collect`.
        rig: Name of a rig that comes with wrenchflow, or path of a rig.toml.
        tare_s: Time at rest at the start, whose end tells the sensor's bias [s].
        latency_s: From the stamp of an observation until its plan arrives [s], beyond the two ticks of measuring.
        force_limit_n: An attempt whose low-passed force peaks above this is no success [N].
        force_cutoff_hz: Of the second-order low-pass before that peak [Hz].
        wrench_input: `felt`, or `zeroed` to see what the policy does without its sense of force.
        batch: Attempts that one worker runs side by side, with one inference for all.
        impedance: How stiffly targets are followed.
        control: Limits and gains of the control core.
    """

    task: str = "peg-insertion"
    episodes: int = 200
    seed: int = 0
    rig: str = "panda_peg"
    tare_s: float = 1.0
    latency_s: float = 0.0
    force_limit_n: float = 25.0
    force_cutoff_hz: float = 50.0
    wrench_input: Literal["felt", "zeroed"] = "felt"
    batch: int = 25
    impedance: Impedance = field(default_factory=Impedance)
    control: ControlConfig = field(default_factory=ControlConfig)

    def __post_init__(self) -> None:
        for name in ("episodes", "batch"):
            if getattr(self, name) < 1:
                raise ConfigError(f"deploy.{name} is {getattr(self, name)}, expected at least 1.")
        for name in ("tare_s", "latency_s", "force_limit_n", "force_cutoff_hz"):
            if not getattr(self, name) >= 0.0:
                raise ConfigError(f"deploy.{name} is {getattr(self, name)}, expected 0 or more.")
