"""The safeguards and the modes by number: what a kernel sets a bit for, and what a recording names.

Kernels read the constants of this file, so it is one of those that `wrenchflow.compiled` looks at for changes. A
safeguard's number is its bit in `CTL.acting` (what intervened at this tick) and in `CTL.without` (what is left out, so
that its worth can be measured in simulation), and the value of `CTL.cause` when it changed the mode.
"""

import numpy as np

# Each with what it does when it acts.
SAFEGUARDS = {
    "gate-state": "the robot's state was not finite, or as no arm can be: latched",
    "gate-request": "a request was not sound: counted, and not followed",
    "gate-torque": "the torque was not finite: latched",
    "workspace": "the target was outside the workspace",
    "stiffness-range": "the stiffness asked for was raised or lowered into its range",
    "damping-range": "the damping ratio asked for was raised or lowered into its range",
    "stiffness-slew": "stiffness rose slower than asked",
    "damping-slew": "the damping ratio rose slower than asked",
    "tank-stiffness": "stiffness rose slower, for the tank could not pay for it",
    "leash": "the reference was kept near the tool",
    "leash-rotation": "the reference was kept near the tool's orientation",
    "speed": "the reference moved slower than asked",
    "turn": "the reference turned slower than asked",
    "contact-zone": "the reference moved slower, for contact is near",
    "tank-reference": "the reference moved less, for the tank could not pay for it",
    "tank-torque": "feed-forward or nullspace torque was lowered, for the tank could not pay for it",
    "tank-debt": "the spring was relaxed to pay what the tank could not",
    "force-cap": "the force asked for was capped",
    "moment-cap": "the moment asked for was capped",
    "arm-speed": "the arm was faster than allowed: braked",
    "torque": "torque was limited",
    "torque-rate": "the change of torque was limited",
    "observer": "more work was done than was budgeted: damped, then latched",
    "silence": "no plan came in time: held",
    "plan-end": "the plan was used up: held",
    "hold-expired": "held for too long: stopped softly",
    "force": "the contact force was too high: retreated",
    "moment": "the contact moment was too high: retreated",
    "impact": "the contact force was far too high: stopped softly",
    "joint-speed": "a joint was near its speed limit: stopped softly",
    "joint-limit": "a joint moved out near its end: stopped softly",
    "overrun": "the control loop was late: stopped softly",
    "stale-state": "the robot's state or its clock stood still or went back: stopped softly",
    "sensor": "the force sensor froze or died: stopped softly",
    "emergency-stop": "somebody stopped it: latched",
}
(
    GATE_STATE,
    GATE_REQUEST,
    GATE_TORQUE,
    WORKSPACE,
    STIFFNESS_RANGE,
    DAMPING_RANGE,
    STIFFNESS_SLEW,
    DAMPING_SLEW,
    TANK_STIFFNESS,
    LEASH,
    LEASH_ROTATION,
    SPEED,
    TURN,
    CONTACT_ZONE,
    TANK_REFERENCE,
    TANK_TORQUE,
    TANK_DEBT,
    FORCE_CAP,
    MOMENT_CAP,
    ARM_SPEED,
    TORQUE,
    TORQUE_RATE,
    OBSERVER,
    SILENCE,
    PLAN_END,
    HOLD_EXPIRED,
    FORCE,
    MOMENT,
    IMPACT,
    JOINT_SPEED,
    JOINT_LIMIT,
    OVERRUN,
    STALE_STATE,
    SENSOR,
    EMERGENCY_STOP,
) = np.arange(len(SAFEGUARDS))  # Not plain integers: numba compiles a function anew for each of those.
NO_CAUSE = np.int64(-1)

MODES = ("run", "hold", "retreat", "soft-stop", "latched")
RUN, HOLD, RETREAT, SOFT_STOP, LATCHED = np.arange(len(MODES))


def names_of(bits: int) -> tuple[str, ...]:
    """Names of the safeguards whose bits are set."""
    return tuple(name for number, name in enumerate(SAFEGUARDS) if bits >> number & 1)


def cause_of(number: int) -> str:
    """Name of the safeguard that changed the mode; `none` where none did."""
    return "none" if number == NO_CAUSE else tuple(SAFEGUARDS)[number]
