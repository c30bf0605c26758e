"""What a person may set about `collect`; loads nothing heavy, so that the command line can show it at once."""

from dataclasses import dataclass, field

from wrenchflow.collect.device import TwistMap
from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class CollectConfig:
    """How demonstrations are recorded.

    Attributes:
        task: Name of the task.
        operator: Who demonstrates.
        episodes: How many attempts are recorded.
        seed: Every random number of episode i comes from (seed, i).
        rig: Name of a rig that comes with wrenchflow, or path of a rig.toml.
        device_hz: Reports of the device a second.
        tare_s: Time at rest, without contact, at the start of an episode, whose end tells the sensor's bias [s].
        disturbance_m: Standard deviation of a slow disturbance of the tracked reference, which shows how errors are
            put right [m]; recorded targets are without it.
        disturbance_s: How long it is correlated [s].
        twist_map: How the device's axes move the target.
        impedance: How stiffly the target is followed.
        control: Limits and gains of the control core.
    """

    task: str = "peg-insertion"
    operator: str = "scripted"
    episodes: int = 10
    seed: int = 0
    rig: str = "panda_peg"
    device_hz: int = 200
    tare_s: float = 1.0
    disturbance_m: float = 0.0003
    disturbance_s: float = 0.2
    twist_map: TwistMap = field(default_factory=TwistMap)
    impedance: Impedance = field(default_factory=Impedance)
    control: ControlConfig = field(default_factory=ControlConfig)

    def __post_init__(self) -> None:
        for name in ("episodes", "device_hz"):
            if getattr(self, name) < 1:
                raise ConfigError(f"collect.{name} is {getattr(self, name)}, expected at least 1.")
        if 1000 % self.device_hz:
            raise ConfigError(f"collect.device_hz is {self.device_hz}, expected a divisor of the 1000 ticks a second.")
        for name in ("tare_s", "disturbance_s"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"collect.{name} is {getattr(self, name)}, expected more than 0.")
        if not self.disturbance_m >= 0.0:
            raise ConfigError(f"collect.disturbance_m is {self.disturbance_m}, expected 0 or more.")
