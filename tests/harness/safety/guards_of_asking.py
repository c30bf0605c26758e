"""Scenarios of what guards a request: gates, ranges, slews, leash, speeds, caps, and the limits of torque."""

import numpy as np

from safety.adversaries import Script, moved, retarget, seen_twist
from safety.arena import Arena
from safety.checks import check
from safety.findings import Finding, worst_of
from safety.limits import check_torque
from wrenchflow.control.config import ControlConfig

PLAIN = {"noisy": False, "control": ControlConfig(ramp_s=0.1)}


def gate_state(without: tuple[str, ...]) -> list[Finding]:
    """Joints that cannot be read for five ticks: nothing that is remembered of the reference is spoilt by it."""
    arena = Arena("free", 1, without=without, **PLAIN)
    retarget(arena, moved(arena, [0.05, 0.0, 0.0]), 100)
    arena.run(300)
    arena.tampers["state"] = lambda obs: obs["x"].fill(np.nan)
    arena.run(5)
    arena.tampers.clear()
    arena.run(100)
    return check(arena, arena.log.trace)


def gate_request(without: tuple[str, ...]) -> list[Finding]:
    """A target that is no number, then a sound one: the arm still runs."""
    arena = Arena("free", 1, without=without, **PLAIN)
    retarget(arena, moved(arena, [0.02, 0.0, 0.0]), 50)
    arena.run(200)
    arena.controller.req[0]["x_stop"][1] = np.inf
    arena.run(50)
    retarget(arena, moved(arena, [0.0, 0.0, 0.0]), 50)
    arena.run(100)
    trace = arena.log.trace
    return [*check(arena, trace), worst_of("a request latches [mode]", trace.after["mode"].astype(float), 1.0)]


def gate_torque(without: tuple[str, ...]) -> list[Finding]:
    """A Jacobian so large that the law's torque is not finite: none such leaves, even if the first gate lets it in."""
    arena = Arena("free", 1, without=("gate-state", *without), **PLAIN)
    retarget(arena, moved(arena, [0.02, 0.0, 0.0]), 50)
    arena.run(200)
    # Not on a tick on which damping is designed, which would take a large Jacobian for a light arm.
    arena.run(5 - int(arena.controller.ctl[0]["tick"]) % 10)
    arena.tampers["state"] = lambda obs: np.multiply(obs["J"], 1e200, out=obs["J"])
    # Finite as it is, so that only its product with the Jacobian is not.
    arena.run(2)
    arena.tampers.clear()
    arena.run(5)
    torque = arena.log.trace.after["tau"]
    return [worst_of("I4 finite torque", (~np.isfinite(torque)).any(1).astype(float), 0.0)]


def _asked(without: tuple[str, ...], place: str, by_m: tuple[float, float, float], ticks: int = 1000) -> list[Finding]:
    arena = Arena(place, 1, without=without, **PLAIN)
    retarget(arena, arena.base_target, 10)
    arena.run(300)
    retarget(arena, moved(arena, np.array(by_m)), 1)
    arena.run(ticks)
    return check(arena, arena.log.trace)


def workspace(without: tuple[str, ...]) -> list[Finding]:
    """A target a metre above: the reference stays inside."""
    return _asked(without, "free", (0.0, 0.0, -1.0), 2500)


def leash(without: tuple[str, ...]) -> list[Finding]:
    """A target half a metre inside the block."""
    return _asked(without, "wall", (0.0, 0.0, 0.5), 1500)


def speed(without: tuple[str, ...]) -> list[Finding]:
    """A target that jumps, but no further than the leash, where nothing is near."""
    return _asked(without, "free", (0.03, 0.0, 0.0))


def contact_zone(without: tuple[str, ...]) -> list[Finding]:
    """A target that jumps by 4 cm close above the block."""
    return _asked(without, "wall", (0.0, 0.0, -0.03))


def _turned(without: tuple[str, ...], place: str, turn_rad: tuple[float, float, float]) -> list[Finding]:
    arena = Arena(place, 1, without=without, **PLAIN)
    retarget(arena, arena.base_target, 10)
    arena.run(300)
    retarget(arena, moved(arena, np.zeros(3), np.array(turn_rad)), 1)
    arena.run(800)
    return check(arena, arena.log.trace)


def turn(without: tuple[str, ...]) -> list[Finding]:
    """An orientation that jumps, but no further than the leash."""
    return _turned(without, "free", (0.0, 0.1, 0.0))


def leash_rotation(without: tuple[str, ...]) -> list[Finding]:
    """A peg in the hole that is asked to lie down, slowly."""
    arena = Arena("hole", 1, without=without, **PLAIN)
    retarget(arena, arena.base_target, 10)
    arena.run(300)
    retarget(arena, moved(arena, np.zeros(3), np.array([0.0, 0.4, 0.0])), 3000)
    arena.run(2000)
    return check(arena, arena.log.trace)


def _gains(without: tuple[str, ...], *steps: dict) -> list[Finding]:
    arena = Arena("free", 1, without=without, **PLAIN)
    for step in steps:
        for name, value in step.items():
            arena.controller.req[0][name] = np.eye(3) * value if name.startswith("K") else value
        retarget(arena, arena.base_target, 10)
        arena.run(400)
    return check(arena, arena.log.trace)


def stiffness_range(without: tuple[str, ...]) -> list[Finding]:
    """Springs far too stiff and far too soft."""
    return _gains(without, {"K_lin": 1e4, "K_rot": 500.0}, {"K_lin": 0.0, "K_rot": 0.0})


def damping_range(without: tuple[str, ...]) -> list[Finding]:
    """A damping ratio that does not damp, and one that is all noise."""
    return _gains(without, {"damping_ratio": 0.05}, {"damping_ratio": 20.0})


def stiffness_slew(without: tuple[str, ...]) -> list[Finding]:
    """Stiffness that jumps from soft to stiff, and back."""
    return _gains(without, {"K_lin": 100.0}, {"K_lin": 1500.0}, {"K_lin": 100.0})


def damping_slew(without: tuple[str, ...]) -> list[Finding]:
    """A damping ratio that jumps."""
    return _gains(without, {"damping_ratio": 0.5}, {"damping_ratio": 2.0})


def _fed(without: tuple[str, ...], place: str, wrench: tuple[float, ...]) -> Arena:
    arena = Arena(place, 1, without=without, **PLAIN)
    retarget(arena, arena.base_target, 10)
    arena.run(600)
    arena.controller.req[0]["wrench"] = np.array(wrench)
    retarget(arena, arena.base_target, 10)
    arena.run(1000)
    return arena


def force_cap(without: tuple[str, ...]) -> list[Finding]:
    """Asked to press with 35 N besides the spring."""
    arena = _fed(without, "wall", (0.0, 0.0, -35.0, 0.0, 0.0, 0.0))
    return check(arena, arena.log.trace)


def moment_cap(without: tuple[str, ...]) -> list[Finding]:
    """Asked for 5 N.m."""
    arena = _fed(without, "free", (0.0, 0.0, 0.0, 0.0, 5.0, 0.0))
    return check(arena, arena.log.trace)


def _rushed(arena: Arena) -> Script:
    # Soft and hardly damped, so that nothing but the brake holds it back.
    arena.controller.req[0]["K_lin"], arena.controller.req[0]["damping_ratio"] = np.eye(3) * 50.0, 0.5
    while True:
        velocity = seen_twist(arena)[:3]
        along = velocity / max(float(np.linalg.norm(velocity)), 1e-3)
        arena.controller.req[0]["wrench"] = np.concatenate([25.0 * along, np.zeros(3)])
        retarget(arena, np.concatenate([arena.controller.obs[0]["x"] + 0.1 * along, arena.base_target[3:]]), 1)
        yield 5


def arm_speed(without: tuple[str, ...]) -> list[Finding]:
    """A soft spring and feed-forward that both pull along the motion: little is left over the speed allowed."""
    arena = Arena("free", 1, without=without, **PLAIN)
    retarget(arena, moved(arena, [0.02, 0.0, 0.0]), 10)
    arena.run(200)
    trace = arena.play(_rushed(arena), ticks=1500)
    config = arena.config
    speed_m_s = np.sqrt((trace.twist[:, :3] ** 2).sum(1))
    # What the largest force can still do against a brake of that time constant, with the lightest arm of 2 kg.
    most_m_s = config.arm_speed_share * config.speed_max_m_s + config.force_max_n * config.brake_s / 2.0
    return [*check(arena, trace), worst_of("speed of the arm [m/s]", speed_m_s, most_m_s)]


def _misread(without: tuple[str, ...], ticks: int) -> list[Finding]:
    """A robot that says that its joints turn when they do not: damping pushes against nothing."""
    arena = Arena("free", 1, without=without, **PLAIN)
    retarget(arena, arena.base_target, 10)
    arena.run(300)
    arena.controller.req[0]["damping_ratio"] = 2.0
    arena.run(1500)
    arena.tampers["state"] = lambda obs: obs["dq"].fill(1.5)
    arena.run(ticks)
    # What a robot tells wrongly of its motion, no ledger can find.
    return check_torque(arena.log.trace, arena.rig, arena.config)


def torque(without: tuple[str, ...]) -> list[Finding]:
    """Joints that seem to turn for long: torque grows at its rate, to its limit."""
    return _misread(without, 250)


def torque_rate(without: tuple[str, ...]) -> list[Finding]:
    """Joints that seem to turn for a moment."""
    return _misread(without, 3)


ASKED = {
    "gate-state": gate_state,
    "gate-request": gate_request,
    "gate-torque": gate_torque,
    "workspace": workspace,
    "stiffness-range": stiffness_range,
    "damping-range": damping_range,
    "stiffness-slew": stiffness_slew,
    "damping-slew": damping_slew,
    "leash": leash,
    "leash-rotation": leash_rotation,
    "speed": speed,
    "turn": turn,
    "contact-zone": contact_zone,
    "force-cap": force_cap,
    "moment-cap": moment_cap,
    "arm-speed": arm_speed,
    "torque": torque,
    "torque-rate": torque_rate,
}
