"""What a person may set about attempts, whoever makes them; loads no simulator, so that `--help` can show it."""

from dataclasses import dataclass, field

from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class AttemptConfig:
    """Some attempts at a task.

    Attributes:
        task: Name of the task.
        episodes: How many attempts.
        seed: Every random number of attempt i comes from (seed, i); `collect` and `deploy` never meet the same scene.
        rig: Name of a rig that comes with wrenchflow, or path of a rig.toml.
        tare_s: Time at rest, without contact, at the start, whose end tells the sensor's bias [s].
        impedance: How stiffly targets are followed.
        control: Limits and gains of the control core.
    """

    task: str = "peg-insertion"
    episodes: int = 1
    seed: int = 0
    rig: str = "panda_peg"
    tare_s: float = 1.0
    impedance: Impedance = field(default_factory=Impedance)
    control: ControlConfig = field(default_factory=ControlConfig)

    def __post_init__(self) -> None:
        self._at_least_one("episodes")
        self._positive("tare_s")

    def _at_least_one(self, *names: str) -> None:
        for name in names:
            if getattr(self, name) < 1:
                raise ConfigError(f"{name} is {getattr(self, name)}, expected at least 1.")

    def _positive(self, *names: str) -> None:
        for name in names:
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"{name} is {getattr(self, name):g}, expected more than 0.")

    def _not_negative(self, *names: str) -> None:
        for name in names:
            if not getattr(self, name) >= 0.0:
                raise ConfigError(f"{name} is {getattr(self, name):g}, expected 0 or more.")
