"""What a person may set about control; loads nothing heavy, so that the command line can show it at once.

Figures without another source are from `docs/safety.md`, which derives them.
"""

import math
from dataclasses import dataclass, fields

from wrenchflow.errors import ConfigError

# What each field of `ControlConfig` may be, both ends included: wide enough for other robots, sensors and tasks; what
# the present ones bear is for `fit.py`. A safeguard that is set so that it never acts is no safeguard, so none can be.
_RANGES: dict[str, tuple[float, float]] = {
    "nullspace_nm_rad": (0.0, 100.0),
    "ramp_s": (0.0, 10.0),
    "damping_design_hz": (10.0, 1000.0),  # More seldom it would be of another posture.
    "force_max_n": (1.0, 150.0),
    "moment_max_nm": (0.05, 20.0),
    "speed_max_m_s": (0.001, 3.0),
    "turn_max_rad_s": (0.005, 4.0),
    "zone_speed_m_s": (0.001, 0.15),  # As fast as elsewhere it would be no zone.
    "zone_slowing_s": (0.1, 5.0),  # In less the arm, which lags behind, would enter the zone too fast.
    "arm_speed_share": (0.5, 2.0),
    "brake_s": (0.001, 0.1),
    "stiffness_min_n_m": (10.0, 3000.0),
    "stiffness_max_n_m": (10.0, 5000.0),
    "stiffness_min_nm_rad": (0.5, 300.0),
    "stiffness_max_nm_rad": (0.5, 300.0),
    "stiffness_fall_n_m_s": (100.0, 2e5),  # At the upper end the default range takes seven ticks,
    "stiffness_fall_nm_rad_s": (5.0, 1e4),  # and six here: faster is a step.
    "damping_ratio_min": (0.2, 3.0),  # Less would ring.
    "damping_ratio_max": (0.2, 3.0),
    "slew_inertia_kg": (1.0, 100.0),  # A little one lets stiffness rise at once: an arm weighs more at its flange,
    "slew_inertia_kg_m2": (0.02, 10.0),  # a Panda 2.4 kg and 0.044 kg m^2.
    "tank_start_j": (0.01, 10.0),  # More would pay for whatever is asked: at 0.25 m/s an arm's own energy is 0.4 J.
    "tank_max_j": (0.01, 10.0),
    "tank_reserve_j": (0.05, 5.0),  # It pays for what nobody asked: a torque that is held, a limit that acts.
    "tank_fill_w": (0.0, 5.0),  # The default force at the default speed spends 6 W.
    "tank_refill_share": (0.0, 1.0),
    "observer_patience_s": (0.001, 0.1),
    "observer_damping_nm_s_rad": (5.0, 50.0),
    "hold_max_s": (0.01, 30.0),
    "stop_s": (0.02, 2.0),
    "brake_nm_s_rad": (2.0, 50.0),  # With less the arm would coast for seconds.
    "retreat_force_n": (1.0, 200.0),
    "retreat_moment_nm": (0.05, 30.0),
    "retreat_patience_s": (0.001, 0.1),
    "retreat_m": (0.0005, 0.05),
    "retreat_max_s": (0.05, 5.0),
    "impact_force_n": (1.0, 300.0),
    "joint_speed_share": (0.1, 1.0),
    "joint_margin_rad": (0.01, 2.0),  # The fastest joint turns by half of the lower end in a tick.
    "overrun_s": (0.0015, 0.01),  # A tick of the loop takes 0.001 s.
    "overruns_max": (1, 10),
    "overrun_max_s": (0.0015, 0.02),
    "stale_s": (0.0015, 0.02),
    "frozen_s": (0.002, 0.2),
    "actuation_latency_s": (0.0, 0.2),
    "torque_share": (0.1, 1.0),
    "torque_rate_share": (0.05, 1.0),
}


@dataclass(frozen=True, kw_only=True)
class Impedance:
    """How stiffly a target is followed, in the base frame."""

    translation_n_m: float = 600.0
    rotation_nm_rad: float = 25.0
    damping_ratio: float = 0.9

    def __post_init__(self) -> None:
        # There is no upper end here: the core limits what is asked, whoever asks.
        for field in fields(self):
            value = getattr(self, field.name)
            if not 0.0 < value < math.inf:
                raise ConfigError(f"impedance.{field.name} is {value:g}, expected a number above 0.")


@dataclass(frozen=True, kw_only=True)
class ControlConfig:
    """Limits and gains of the control core that no request can change.

    Attributes:
        nullspace_nm_rad: Stiffness of the posture [N.m/rad].
        ramp_s: Gains rise from zero over this [s].
        damping_design_hz: Damping is designed anew so often [Hz].
        force_max_n: Most that the spring and feed-forward may pull with; the leash follows from it [N].
        moment_max_nm: The same for rotation [N.m].
        speed_max_m_s: Of the reference [m/s].
        turn_max_rad_s: Of the reference [rad/s].
        zone_speed_m_s: Of the reference where the task expects contact [m/s].
        zone_slowing_s: Outside it may be faster by the distance over this time [s]: about the arm's lag, D / K.
        arm_speed_share: What the arm itself may move at, over what the reference may.
        brake_s: Time constant with which an arm that is faster is braked [s].
        stiffness_min_n_m: Softest spring [N/m].
        stiffness_max_n_m: Stiffest spring [N/m].
        stiffness_min_nm_rad: Softest spring of rotation [N.m/rad].
        stiffness_max_nm_rad: Stiffest spring of rotation [N.m/rad].
        stiffness_fall_n_m_s: Fastest fall [N/m/s].
        stiffness_fall_nm_rad_s: Fastest fall of rotation [N.m/rad/s].
        damping_ratio_min: Least damping ratio.
        damping_ratio_max: More damping than this is mostly the noise of the measured velocity: from three on it fills
            the torque's rate.
        slew_inertia_kg: Largest task inertia that the slew of stiffness reckons with [kg].
        slew_inertia_kg_m2: The same for rotation [kg m^2].
        tank_start_j: Energy in the tank at the start [J].
        tank_max_j: Most that it holds [J].
        tank_reserve_j: What voluntary changes leave in it [J].
        tank_fill_w: What is filled in while plans come in time [W].
        tank_refill_share: Of damped energy that comes back.
        observer_patience_s: How long work may be over budget before the arm is latched [s].
        observer_damping_nm_s_rad: Joint damping meanwhile [N.m.s/rad].
        hold_max_s: A hold that lasts longer becomes a soft stop [s].
        stop_s: Stiffness falls to zero over this in a soft stop [s].
        brake_nm_s_rad: Joint damping after a stop: stops the arm in half a second, no match for a hand [N.m.s/rad].
        retreat_force_n: Low-passed at 50 Hz, above which the arm retreats [N].
        retreat_moment_nm: The same for the moment about the TCP [N.m].
        retreat_patience_s: For how long in a row [s].
        retreat_m: How far [m].
        retreat_max_s: How long a retreat may take [s].
        impact_force_n: Low-passed at 200 Hz, above which the arm stops softly [N].
        joint_speed_share: Of a joint's speed limit, above which the arm stops softly.
        joint_margin_rad: How near its end a joint may be that moves out [rad].
        overrun_s: A tick that takes longer is an overrun [s].
        overruns_max: So many in a row stop the arm softly.
        overrun_max_s: And so does one that takes this long [s].
        stale_s: For how long the robot's state may stand still [s].
        frozen_s: For how long the sensor's reading may stay the same to the last bit [s].
        actuation_latency_s: From a command until the arm does it; plans are followed ahead by it [s].
        torque_share: Of the robot's torque limits, that a command may use: a margin for what happens between two ticks.
        torque_rate_share: The same for the change of torque.
    """

    nullspace_nm_rad: float = 2.0
    ramp_s: float = 1.0
    damping_design_hz: float = 100.0
    force_max_n: float = 25.0
    moment_max_nm: float = 3.0
    speed_max_m_s: float = 0.25
    turn_max_rad_s: float = 1.0
    zone_speed_m_s: float = 0.05
    zone_slowing_s: float = 0.2
    arm_speed_share: float = 1.2
    brake_s: float = 0.01
    stiffness_min_n_m: float = 50.0
    stiffness_max_n_m: float = 1500.0
    stiffness_min_nm_rad: float = 2.0
    stiffness_max_nm_rad: float = 60.0
    stiffness_fall_n_m_s: float = 5e4
    stiffness_fall_nm_rad_s: float = 2e3
    damping_ratio_min: float = 0.5
    damping_ratio_max: float = 2.0
    slew_inertia_kg: float = 12.0
    slew_inertia_kg_m2: float = 0.5
    tank_start_j: float = 2.0
    tank_max_j: float = 3.0
    tank_reserve_j: float = 0.05
    tank_fill_w: float = 1.0
    tank_refill_share: float = 0.9
    observer_patience_s: float = 0.02
    observer_damping_nm_s_rad: float = 20.0
    hold_max_s: float = 1.0
    stop_s: float = 0.25
    brake_nm_s_rad: float = 10.0
    retreat_force_n: float = 40.0
    retreat_moment_nm: float = 6.0
    retreat_patience_s: float = 0.005
    retreat_m: float = 0.005
    retreat_max_s: float = 1.0
    impact_force_n: float = 80.0
    joint_speed_share: float = 0.9
    joint_margin_rad: float = 0.05
    overrun_s: float = 0.002
    overruns_max: int = 3
    overrun_max_s: float = 0.005
    stale_s: float = 0.002
    frozen_s: float = 0.02
    actuation_latency_s: float = 0.0
    torque_share: float = 0.96
    torque_rate_share: float = 0.5

    def __post_init__(self) -> None:
        for field in fields(self):
            value, (low, high) = getattr(self, field.name), _RANGES[field.name]
            if not low <= value <= high:
                raise ConfigError(f"control.{field.name} is {value}, expected from {low:g} to {high:g}.")
