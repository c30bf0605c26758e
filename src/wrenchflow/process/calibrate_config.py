"""What a person may set about `calibrate`; loads nothing heavy, so that the command line can show it at once."""

from dataclasses import dataclass, field, fields

from wrenchflow.config import require_at_least, require_between, require_positive
from wrenchflow.robot_limits import Vector3


@dataclass(frozen=True, kw_only=True)
class MotionConfig:
    """The calibration motion.

    Attributes:
        poses: In how many ways the tool is held.
        rest_s: For how long the arm rests at each [s].
        settle_max_s: How long it may take to come to rest before [s].
        turn_rad_s: How fast the tool is turned [rad/s].
    """

    poses: int = 6
    rest_s: float = 1.5
    settle_max_s: float = 10.0
    turn_rad_s: float = 0.4

    def __post_init__(self) -> None:
        require_between(4, 30, **{"motion.poses": self.poses})
        require_at_least(1.0, **{"motion.rest_s": self.rest_s})
        require_between(0.5, 60.0, **{"motion.settle_max_s": self.settle_max_s})
        require_between(0.05, 1.0, **{"motion.turn_rad_s": self.turn_rad_s})


@dataclass(frozen=True, kw_only=True)
class RestConfig:
    """What counts as rest.

    Attributes:
        min_s: A shorter one does not count [s].
        window_s: Where no rests are marked: over so long it is looked whether the tool moves [s].
        max_speed_m_s: A tool that is faster moves [m/s].
        max_turn_rad_s: A tool that turns faster turns [rad/s].
        max_turned_rad: Most that the tool may turn within a rest [rad].
        max_joint_velocity_rad_s: Any joint that is faster is moving [rad/s].
        max_spread: Most standard deviation of the reading, in multiples of the sensor's own noise.
        max_drift: Most change of the reading from start to end, in multiples of the sensor's own noise.
    """

    min_s: float = 0.5
    window_s: float = 0.1
    max_speed_m_s: float = 0.003
    max_turn_rad_s: float = 0.01
    max_turned_rad: float = 0.005
    max_joint_velocity_rad_s: float = 0.01
    max_spread: float = 2.0
    max_drift: float = 2.0

    def __post_init__(self) -> None:
        require_positive(**{f"rests.{of.name}": getattr(self, of.name) for of in fields(self)})
        require_at_least(2.0 * self.window_s, **{"rests.min_s": self.min_s})


@dataclass(frozen=True, kw_only=True)
class Doubt:
    """What else may be wrong than noise: standard deviations of what nobody has measured.

    Attributes:
        orientation_rad: Constant error of the orientation that the arm says it has, as the length of a rotation [rad].
        drift_n_min: Drift of the sensor's bias [N/min].
        drift_nm_min: The same of the moments [N.m/min].
    """

    orientation_rad: float = 1e-3
    drift_n_min: float = 0.05
    drift_nm_min: float = 0.002

    def __post_init__(self) -> None:
        require_positive(**{f"doubt.{of.name}": getattr(self, of.name) for of in fields(self)})


@dataclass(frozen=True, kw_only=True)
class AcceptConfig:
    """What makes a calibration one that is refused; the condition number has its own limit.

    Attributes:
        max_left_n: Most force that the payload and the bias may leave of any rest [N], besides noise.
        max_left_nm: The same of the moment [N.m].
        max_com_m: A centre of mass that is further from the sensor is none [m].
        max_mass_std_share: Most standard deviation of the mass, as a share of it.
    """

    max_left_n: float = 0.25
    max_left_nm: float = 0.03
    max_com_m: float = 0.5
    max_mass_std_share: float = 0.05

    def __post_init__(self) -> None:
        require_positive(**{f"accept.{of.name}": getattr(self, of.name) for of in fields(self)})


@dataclass(frozen=True, kw_only=True)
class IdentifyConfig:
    """How a payload is told from rests.

    Attributes:
        rests: What counts as rest.
        doubt: What else may be wrong than noise.
        accept: What makes a result one that is refused.
    """

    rests: RestConfig = field(default_factory=RestConfig)
    doubt: Doubt = field(default_factory=Doubt)
    accept: AcceptConfig = field(default_factory=AcceptConfig)


@dataclass(frozen=True, kw_only=True)
class CalibrateConfig(IdentifyConfig):
    """A calibration, from recordings or from a motion in simulation.

    Attributes:
        rig: Name of a rig that comes with wrenchflow, or path of a rig.toml; without it that of the recordings, and
            `panda_peg` in simulation.
        seed: Of the simulated sensor, and of the payload where none is given.
        true_mass_kg: What really hangs below the simulated sensor [kg]; without it the rig's, up to 30 % off.
        true_com_sensor_m: Its centre of mass [m]; without it the rig's, up to 10 mm off each way.
        motion: The motion in simulation.
    """

    rig: str | None = None
    seed: int = 0
    true_mass_kg: float | None = None
    true_com_sensor_m: Vector3 | None = None
    motion: MotionConfig = field(default_factory=MotionConfig)

    def __post_init__(self) -> None:
        if self.true_mass_kg is not None:
            require_positive(true_mass_kg=self.true_mass_kg)
