"""What a person may set about attempts, whoever makes them; loads no simulator, so that `--help` can show it."""

from dataclasses import dataclass, field
from pathlib import Path

from wrenchflow.config import require_between
from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class AttemptConfig:
    """Some attempts at a task.

    Attributes:
        task: Name of the task.
        episodes: How many attempts.
        seed: Every random number of attempt i comes from (seed, i); `collect` and `deploy` never meet the same scene.
        rig: Name of a rig that comes with wrenchflow, or path of a rig.toml; without it, the task's own.
        calibration: A file that `calibrate` wrote, whose payload takes the place of the rig's.
        tare_s: Time at rest, without contact, at the start, whose end tells the sensor's bias [s].
        impedance: How stiffly targets are followed.
        control: Limits and gains of the control core.
    """

    task: str = "peg-insertion"
    episodes: int = 1
    seed: int = 0
    rig: str | None = None
    calibration: Path | None = None
    tare_s: float = 1.0
    impedance: Impedance = field(default_factory=Impedance)
    control: ControlConfig = field(default_factory=ControlConfig)

    @property
    def patience(self) -> float:
        """How long an attempt may last, over the task's own time limit."""
        return 1.0

    def __post_init__(self) -> None:
        require_between(1, 100_000, episodes=self.episodes)
        if not 0.4 <= self.tare_s <= 60.0:  # Its second half is what the bias is told from.
            raise ConfigError(f"tare_s is {self.tare_s:g}, expected from 0.4 to 60.")
