"""What a person may set about `collect`; loads nothing heavy, so that the command line can show it at once."""

from dataclasses import dataclass, field
from typing import Literal

from wrenchflow.collect.device_config import DeviceConfig
from wrenchflow.collect.devices.twist_map import TwistMap
from wrenchflow.config import require_at_least, require_between, require_positive
from wrenchflow.control.config import Impedance
from wrenchflow.errors import ConfigError
from wrenchflow.sim.config import AttemptConfig

# Operators that are a person with a device, and go by the clock.
PEOPLE = ("spacemouse", "keyboard", "gamepad", "replay", "lerobot")
TIMED = ("scripted", "blind-spiral")  # They are judged by the time that a policy has.


@dataclass(frozen=True, kw_only=True)
class CameraConfig:
    """Pictures of a camera.

    Attributes:
        width: Of a picture [pixels].
        height: Of a picture [pixels].
        rate_hz: Pictures a second.
    """

    width: int = 224
    height: int = 224
    rate_hz: float = 30.0

    def __post_init__(self) -> None:
        require_at_least(1, width=self.width, height=self.height)
        require_positive(rate_hz=self.rate_hz)
        if self.width > 4096 or self.height > 4096 or self.rate_hz > 1000.0:
            raise ConfigError(
                f"a camera of {self.width} x {self.height} at {self.rate_hz:g} Hz is too much, expected at most "
                "4096 x 4096 at 1000 Hz."
            )


@dataclass(frozen=True, kw_only=True)
class CollectConfig(AttemptConfig):
    """How demonstrations are recorded.

    Attributes:
        episodes: How many attempts are recorded.
        operator: Who demonstrates: scripted, emulated, hand-guided or blind-spiral, in virtual time; or a person with a
            spacemouse, keyboard, gamepad, what lerobot drives, or the replay of a recording, which go by the clock.
        profiles: The people who take turns as the emulated operator, such as `steady novice`; without any, all.
        guided: How stiffly the arm is held while a hand leads it; in place of `impedance`, for `hand-guided`.
        device_hz: Reports of the device a second.
        disturbance_m: Standard deviation of a slow disturbance of the tracked reference, which shows how errors are
            put right [m]; recorded targets are without it.
        disturbance_s: How long it is correlated [s].
        realtime: Let ticks go by the clock, and record while it happens, as on a real arm; one episode after the other.
        live: Show each episode in Rerun while it is recorded, which goes by the clock then; needs wrenchflow[view].
        compression: Of the recordings: zstd, lz4 or none.
        cameras: The rig's cameras that are recorded, such as `wrist scene`.
        camera: Size and rate of their pictures.
        device: What a person holds.
        twist_map: How the device's axes move the target.
        time_limit_s: How long an attempt may last [s]; without it as long as the task says, but a minute for people.
        tares: How often the sensor is tared at most: once more where something moved or touched the arm.
        tare_wait_s: Between a tare that was refused and the next [s].
    """

    episodes: int = 10
    operator: str = "scripted"
    profiles: tuple[str, ...] = ()
    guided: Impedance = field(default_factory=lambda: Impedance(translation_n_m=75.0, rotation_nm_rad=5.0))
    device_hz: int = 200
    disturbance_m: float = 0.0003
    disturbance_s: float = 0.2
    realtime: bool = False
    live: bool = False
    compression: Literal["zstd", "lz4", "none"] = "zstd"
    cameras: tuple[str, ...] = ()
    camera: CameraConfig = field(default_factory=CameraConfig)
    device: DeviceConfig = field(default_factory=DeviceConfig)
    twist_map: TwistMap = field(default_factory=TwistMap)
    time_limit_s: float | None = None
    tares: int = 3
    tare_wait_s: float = 1.0

    @property
    def patience(self) -> float:
        """How long an attempt may last, over the task's own time limit: people are given three times as long."""
        return 1.0 if self.operator in TIMED else 3.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_between(1, 1000, device_hz=self.device_hz)
        require_between(1, 100, tares=self.tares)
        require_between(0, 60, tare_wait_s=self.tare_wait_s)
        # Further off the operator would not find what they see; for longer it would be an offset and no disturbance.
        require_between(0, 0.01, disturbance_m=self.disturbance_m)
        require_between(0.001, 60, disturbance_s=self.disturbance_s)
        if self.time_limit_s is not None and not 0.0 < self.time_limit_s <= 3600.0:
            raise ConfigError(f"time_limit_s is {self.time_limit_s:g}, expected more than 0 and 3600 at most.")
        if len(set(self.cameras)) != len(self.cameras):
            raise ConfigError(f"cameras are {', '.join(self.cameras)}, expected each at most once.")
        if not 50.0 <= self.guided.translation_n_m <= 200.0:
            raise ConfigError(
                f"guided.translation_n_m is {self.guided.translation_n_m:g}, expected from 50 to 200: what is stiffer "
                "cannot be led by hand."
            )
        if 1.0 / self.device_hz > self.twist_map.dead_man_s:
            raise ConfigError(
                f"device_hz is {self.device_hz}, so that reports come further apart than the "
                f"{self.twist_map.dead_man_s:g} s after which a device counts as silent (twist_map.dead_man_s)."
            )
        if 1000 % self.device_hz:
            raise ConfigError(f"device_hz is {self.device_hz}, expected a divisor of the 1000 ticks a second.")

    @property
    def is_paced(self) -> bool:
        """Whether ticks go by the clock."""
        return self.realtime or self.live or self.operator in PEOPLE
