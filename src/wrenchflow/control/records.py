"""The three records that the control kernels share: what is seen, what is asked, and everything that is remembered.

Plain structured memory: a batch of controllers is an array of `CTL`, a snapshot is its bytes. A real arm fills the same
`OBS` as the simulated one; nothing else changes.
"""

import numpy as np

# Kernels read the constants of this file, so it is one of those that `wrenchflow.compiled` looks at for changes.
JOINTS = 7


def _record(fields: list[tuple]) -> np.dtype:
    # `np.record` gives plain Python the field access, `obs.q`, that compiled code has anyway.
    return np.dtype((np.record, np.dtype(fields, align=True)))


# What the robot says at one tick. Poses and the Jacobian are of the TCP in the base frame, world-aligned, linear first.
OBS = _record(
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
REQ = _record(
    [
        ("x_start", "f8", 3),
        ("x_stop", "f8", 3),
        ("R_start", "f8", (3, 3)),
        ("turn", "f8", 3),  # rotation vector from the start to the end of the segment, base axes [rad]
        ("ticks", "i8"),
        ("K_lin", "f8", (3, 3)),  # [N/m]
        ("K_rot", "f8", (3, 3)),  # [N.m/rad]
        ("damping_ratio", "f8"),
        ("x_offset", "f8", 3),  # a disturbance to be tracked besides, which is not part of the target [m]
    ]
)

# All that the controller remembers, and its limits.
CTL = _record(
    [
        ("tick", "i8"),  # ticks since the start
        ("segment_tick", "i8"),  # ticks into the present segment
        ("rejected", "i8"),  # requests that were not sound, and so not followed
        ("fault", "i8"),  # a FAULT_* code; anything but FAULT_NONE is latched
        ("x_target", "f8", 3),  # what is asked at this tick, before leash and limits
        ("R_target", "f8", (3, 3)),
        ("x_offset", "f8", 3),  # the disturbance in force [m]
        ("x_d", "f8", 3),  # the reference that is tracked
        ("R_d", "f8", (3, 3)),
        ("q_null", "f8", JOINTS),
        ("tau", "f8", JOINTS),  # last command [N.m]
        ("D", "f8", (6, 6)),  # damping, task space
        ("P", "f8", (6, JOINTS)),  # Lambda J M^-1, which takes joint torque to its task-space share
        ("K_lin", "f8", (3, 3)),  # stiffness in force
        ("K_rot", "f8", (3, 3)),
        ("damping_ratio", "f8"),
        ("null_stiffness", "f8"),  # [N.m/rad]
        ("ramp_ticks", "i8"),  # gains rise from zero over these
        ("design_ticks", "i8"),  # damping is designed again after these
        ("tau_max", "f8", JOINTS),  # [N.m]
        ("tau_step_max", "f8", JOINTS),  # change of torque in one tick [N.m]
        ("force_max", "f8"),  # spring force that the leash and the cap allow [N]
        ("moment_max", "f8"),  # [N.m]
        ("x_step_max", "f8"),  # voluntary step of the reference in one tick [m]
        ("turn_step_max", "f8"),  # [rad]
        ("workspace_min", "f8", 3),  # [m]
        ("workspace_max", "f8", 3),
        ("K_lin_max", "f8"),  # [N/m]
        ("K_rot_max", "f8"),  # [N.m/rad]
        ("damping_ratio_max", "f8"),
        # What a tick works with, kept here so that the loop allocates nothing.
        ("e", "f8", 6),  # error of the pose, world-aligned [m, rad]
        ("V", "f8", 6),  # twist [m/s, rad/s]
        ("F", "f8", 6),  # task-space wrench [N, N.m]
        ("posture", "f8", JOINTS),  # nullspace torque, its task-space share still in it [N.m]
        ("tau_wanted", "f8", JOINTS),  # the law's torque, before limits [N.m]
        ("vector", "f8", 4),
        ("matrices", "f8", (3, 3, 3)),
    ]
)

FAULT_NONE = 0
FAULT_STATE = 1  # the robot's state was not finite
FAULT_TORQUE = 2  # the law's torque was not finite
