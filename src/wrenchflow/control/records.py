"""The records that the control kernels share: what is seen, what is asked, and everything that is remembered.

Plain structured memory: a batch of controllers is an array of `CTL`, a snapshot is its bytes. A real arm fills the same
`OBS` as the simulated one; nothing else changes.
"""

import numpy as np

# Kernels read the constants of this file, so it is one of those that `wrenchflow.compiled` looks at for changes.
JOINTS = 7


def record_dtype(fields: list[tuple]) -> np.dtype:
    """A structured dtype; `np.record` gives plain Python the field access, `obs.q`, that compiled code has anyway."""
    return np.dtype((np.record, np.dtype(fields, align=True)))


# What the robot says at one tick. Poses and the Jacobian are of the TCP in the base frame, world-aligned, linear first.
OBS = record_dtype(
    [
        ("t_ns", "i8"),
        ("q", "f8", JOINTS),  # [rad]
        ("dq", "f8", JOINTS),  # [rad/s]
        ("tau", "f8", JOINTS),  # measured torque without gravity [N.m]
        ("tau_external", "f8", JOINTS),  # measured minus modelled [N.m]; the last tick's
        ("x", "f8", 3),  # [m]
        ("R", "f8", (3, 3)),
        ("J", "f8", (6, JOINTS)),
        ("M", "f8", (JOINTS, JOINTS)),  # joint inertia, rotors included [kg m^2]
        ("coriolis", "f8", JOINTS),  # c(q, dq) [N.m]
        ("wrench", "f8", 6),  # as the sensor gives it, sensor frame [N, N.m]; the last tick's
    ]
)

# What is asked: a straight segment of the target over `ticks` ticks, and how stiffly to follow it.
REQ = record_dtype(
    [
        ("x_start", "f8", 3),
        ("x_stop", "f8", 3),
        ("R_start", "f8", (3, 3)),
        ("turn", "f8", 3),  # rotation vector from the start to the end of the segment, base axes [rad]
        ("ticks", "i8"),
        ("patience_ticks", "i8"),  # silence after which the arm holds; 0 for a request that does not expire
        ("K_lin", "f8", (3, 3)),  # [N/m]
        ("K_rot", "f8", (3, 3)),  # [N.m/rad]
        ("damping_ratio", "f8"),
        ("wrench", "f8", 6),  # feed-forward: exerted besides the spring, base axes, about the TCP [N, N.m]
        ("x_offset", "f8", 3),  # a disturbance at the end, to be tracked besides; not part of the target [m]
    ]
)

# What the controller remembers of one arm, and its limits.
CTL = record_dtype(
    [
        # Where it stands.
        ("tick", "i8"),  # ticks since the start
        ("segment_tick", "i8"),  # ticks into the present segment
        ("follows_plan", "i8"),  # whether the target comes from the schedule; else from the segment
        ("mode", "i8"),  # of safeguards.MODES
        ("mode_tick", "i8"),  # ticks in this mode
        ("cause", "i8"),  # the safeguard that changed the mode, or NO_CAUSE
        ("acting", "i8"),  # safeguards that intervened at this tick, a bit each
        ("without", "i8"),  # safeguards that are left out, a bit each; 0 but in simulation
        ("pending", "i8"),  # safeguards that intervened since the last tick, between two
        ("is_waiting", "i8"),  # held since the start, for nothing has been asked yet
        ("is_asked", "i8"),  # a segment was asked for since the last tick
        ("was_asked", "i8"),  # one was, since the start
        ("is_fresh", "i8"),  # something sound was
        ("silent_ticks", "i8"),  # since something was asked
        ("patience_ticks", "i8"),  # silence after which the arm holds; 0 for a request that does not expire
        ("is_refused", "i8"),  # the segment is not sound
        ("is_stop_asked", "i8"),  # an emergency stop
        ("rejected", "i8"),  # requests that were not sound, and so not followed
        ("counts", "i8", 64),  # ticks in which each safeguard intervened
        # What is asked at this tick, before leash and limits.
        ("x_target", "f8", 3),
        ("R_target", "f8", (3, 3)),
        ("K_lin_target", "f8", (3, 3)),
        ("K_rot_target", "f8", (3, 3)),
        ("damping_ratio_target", "f8"),
        ("wrench_target", "f8", 6),  # feed-forward [N, N.m]
        ("gripper_target", "f8"),  # width [m]; NaN where none is asked
        ("x_offset", "f8", 3),  # the disturbance in force [m]
        ("x_offset_start", "f8", 3),  # and at the beginning of the segment
        # What is given.
        ("x_d", "f8", 3),  # the reference that is tracked
        ("R_d", "f8", (3, 3)),
        ("K_lin", "f8", (3, 3)),  # stiffness in force, but for `gain`
        ("K_rot", "f8", (3, 3)),
        ("damping_ratio", "f8"),
        ("gain", "f8"),  # share of the stiffness, from 0 to 1 after the start, and back in a soft stop
        ("wrench_command", "f8", 6),  # feed-forward after caps and tank [N, N.m]
        ("q_null", "f8", JOINTS),
        ("tau", "f8", JOINTS),  # last command [N.m]
        ("D", "f8", (6, 6)),  # damping, task space
        ("P", "f8", (6, JOINTS)),  # Lambda J M^-1, which takes joint torque to its task-space share
        ("inertia", "f8", (6, 6)),  # task inertia, a block for translation and one for rotation [kg, kg m^2]
        # Energy [J]; the last six are sums since the start.
        ("tank", "f8"),
        ("spring", "f8"),  # potential of the spring, after this tick's changes of reference and stiffness
        ("budget", "f8"),  # what the observer still allows; below zero it intervenes
        ("kinetic", "f8"),
        ("damped", "f8"),  # work that damping took out
        ("fed", "f8"),  # work of feed-forward
        ("posed", "f8"),  # work of nullspace and Coriolis torque
        ("saturated", "f8"),  # work of what the limits of torque changed
        ("exerted", "f8"),  # work on the environment, by the robot's external torque
        ("filled", "f8"),  # what was given to the tank while plans came in time
        # Force, as the safety layer sees it: what the robot exerts, about the TCP, base axes.
        ("wrench", "f8", 6),  # low-passed at `wrench_lowpass_hz` [N, N.m]
        ("impact", "f8", 3),  # low-passed at `impact_lowpass_hz` [N]
        ("bias", "f8", 6),  # of the sensor, sensor frame
        ("bias_ticks", "i8"),  # how many readings it rests on
        ("takes_bias", "i8"),  # while waiting
        ("wrench_raw_last", "f8", 6),
        ("frozen_ticks", "i8", 6),  # a channel: for how long it has been the same to the last bit
        ("dead_ticks", "i8"),
        ("over_ticks", "i8", 5),  # force, moment, energy, overrun, stale: for how many ticks in a row
        ("R_tcp_sensor", "f8", (3, 3)),
        ("x_tcp_sensor", "f8", 3),
        ("payload_kg", "f8"),
        ("payload_com", "f8", 3),  # sensor frame [m]
        ("wrench_sos", "f8", (1, 6)),
        ("wrench_state", "f8", (1, 2, 6)),
        ("impact_sos", "f8", (1, 6)),
        ("impact_state", "f8", (1, 2, 3)),
        # What the last tick left, for the energy of this one.
        ("t_last_ns", "i8"),
        ("q_last", "f8", JOINTS),
        ("tau_spring", "f8", JOINTS),
        ("tau_damping", "f8", JOINTS),
        ("tau_fed", "f8", JOINTS),
        ("tau_posed", "f8", JOINTS),
        ("x_retreat", "f8", 3),
        ("retreat_ns", "i8"),  # when the last retreat ended: plans made before are not followed
        # Limits and constants; `Controller` sets them once.
        ("null_stiffness", "f8"),  # [N.m/rad]
        ("ramp_ticks", "i8"),  # gains rise from zero over these
        ("design_ticks", "i8"),  # damping is designed again after these
        ("tau_max", "f8", JOINTS),  # [N.m]
        ("tau_step_max", "f8", JOINTS),  # change of torque in one tick [N.m]
        ("force_max", "f8"),  # spring force that the leash and the cap allow [N]
        ("moment_max", "f8"),  # [N.m]
        ("x_step_max", "f8"),  # voluntary step of the reference in one tick [m]
        ("turn_step_max", "f8"),  # [rad]
        ("arm_speed_share", "f8"),  # what the arm may move at, over what the reference may
        ("brake_rate", "f8"),  # at which the arm's excess speed is damped [1/s]
        ("workspace_min", "f8", 3),  # [m]
        ("workspace_max", "f8", 3),
        ("zone_min", "f8", 3),  # where contact is expected [m]; empty where min is above max
        ("zone_max", "f8", 3),
        ("zone_step_max", "f8"),  # voluntary step of the reference there [m]
        ("zone_slowing", "f8"),  # how much larger it may be a metre away from there
        ("K_lin_min", "f8"),  # [N/m]
        ("K_lin_max", "f8"),
        ("K_rot_min", "f8"),  # [N.m/rad]
        ("K_rot_max", "f8"),
        ("K_lin_fall_max", "f8"),  # in one tick
        ("K_rot_fall_max", "f8"),
        ("damping_ratio_min", "f8"),
        ("damping_ratio_max", "f8"),
        ("inertia_lin_max", "f8"),  # largest task inertia that the slew reckons with [kg]
        ("inertia_rot_max", "f8"),  # [kg m^2]
        ("tank_start", "f8"),  # [J]
        ("tank_max", "f8"),
        ("tank_reserve", "f8"),
        ("tank_fill", "f8"),  # a tick [J]
        ("refill_share", "f8"),  # of damped energy
        ("overdraft_ticks_max", "i8"),
        ("observer_damping", "f8"),  # joint damping while the budget is overdrawn [N.m.s/rad]
        ("brake", "f8"),  # joint damping of a stop [N.m.s/rad]
        ("hold_ticks_max", "i8"),
        ("stop_step", "f8"),  # by which the gain falls in a tick of a soft stop
        ("retreat_m", "f8"),
        ("retreat_ticks_max", "i8"),
        ("retreat_force", "f8"),  # [N]
        ("retreat_moment", "f8"),  # [N.m]
        ("retreat_patience_ticks", "i8"),  # for how long in a row it must be over
        ("impact_force", "f8"),  # [N]
        ("dq_max", "f8", JOINTS),  # [rad/s]
        ("q_min", "f8", JOINTS),  # [rad]
        ("q_max", "f8", JOINTS),
        ("dq_slope", "f8", JOINTS),  # of robots whose speed limit falls towards a joint's ends [rad/s^2]; 0 for others
        ("dq_offset", "f8", JOINTS),  # [rad/s]
        ("dq_q_min", "f8", JOINTS),  # where it falls to: ends of this curve, not of the joint [rad]
        ("dq_q_max", "f8", JOINTS),
        ("dq_share", "f8"),
        ("q_margin", "f8"),  # [rad]
        ("overrun_ns", "i8"),  # a step of the clock longer than this is an overrun
        ("overrun_max_ns", "i8"),  # and longer than this a stop
        ("overruns_max", "i8"),
        ("stale_ticks_max", "i8"),
        ("dead_ticks_max", "i8"),
        ("frozen_ticks_max", "i8"),  # 0 for a sensor without noise, which cannot be told from a frozen one
        # What a tick works with, kept here so that the loop allocates nothing.
        ("e", "f8", 6),  # error of the pose, world-aligned [m, rad]
        ("V", "f8", 6),  # twist [m/s, rad/s]
        ("F", "f8", 6),  # task-space wrench [N, N.m]
        ("posture", "f8", JOINTS),  # nullspace torque, its task-space share still in it [N.m]
        ("tau_wanted", "f8", JOINTS),  # the law's torque, before limits [N.m]
        ("vector", "f8", 6),
        ("sample", "f8", 6),
        ("step", "f8", 6),  # of the reference [m, rad]
        ("matrices", "f8", (6, 3, 3)),
    ]
)
