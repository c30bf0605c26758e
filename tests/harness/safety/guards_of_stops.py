"""Scenarios of what changes the mode: somebody falls silent, something hits or presses, the robot or a clock fails."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.signal import butter, sosfilt

from safety.adversaries import moved, retarget
from safety.arena import Arena
from safety.checks import check
from safety.findings import Finding
from safety.modes import check_rest, check_silence
from safety.packets import now_ns, plan_of
from safety.trace import Trace
from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.control.plan import packet_of
from wrenchflow.control.safeguards import HOLD, LATCHED, RETREAT, RUN, SOFT_STOP

CONFIG = ControlConfig(ramp_s=0.1)
TICK_S = 0.001


def stopped(trace: Trace, name: str, since: int, within: int, least: int) -> Finding:
    """In how many ticks the mode was less than it should be, from some ticks after the cause on."""
    late = trace.after["mode"][since + within :] < least
    return Finding(f"{name} [ticks not stopped]", float(late.sum()), 0.0, since + within + int(np.argmax(late)))


def _running(place: str, without: tuple[str, ...], *, noisy: bool = True, ticks: int = 600) -> Arena:
    arena = Arena(place, 1, noisy=noisy, control=CONFIG, without=without)
    retarget(arena, arena.base_target, 50)
    arena.run(ticks)
    return arena


def silence(without: tuple[str, ...]) -> list[Finding]:
    """A request that is meant to come every 50 ms, and comes no more."""
    arena = _running("free", without)
    retarget(arena, moved(arena, [0.05, 0.0, 0.0]), 1000, every_s=0.05)
    arena.run(400)
    return check_silence(arena.log.trace)


def plan_end(without: tuple[str, ...]) -> list[Finding]:
    """A plan of 50 ms from a policy that will not plan again for a second: it is not waited for."""
    arena = _running("free", without)
    pose = moved(arena, [0.01, 0.0, 0.0])[None]
    plan = replace(plan_of(arena, pose, Impedance()), period_ns=1_000_000_000)
    arena.controller.accept(packet_of(plan), now_ns(arena))
    start = arena.log.count + 50
    arena.run(400)
    return [stopped(arena.log.trace, "a plan that is used up", start, 2, HOLD)]


def hold_expired(without: tuple[str, ...]) -> list[Finding]:
    """The same for longer: after a second of holding the arm goes soft, and comes to rest."""
    arena = _running("free", without)
    retarget(arena, moved(arena, [0.05, 0.0, 0.0]), 1000, every_s=0.05)
    start = arena.log.count + 125
    arena.run(3400)
    trace = arena.log.trace
    return [*check_rest(trace), stopped(trace, "held for too long", start, 1002, SOFT_STOP)]


def lowpassed(trace: Trace, cutoff_hz: float) -> np.ndarray:
    """Size of the true force of contact, low-passed [N]. Shape (n,)."""
    sections = butter(2, cutoff_hz, fs=1.0 / TICK_S, output="sos")
    return np.sqrt((np.asarray(sosfilt(sections, trace.truth["contact"], axis=0)) ** 2).sum(1))


def force(without: tuple[str, ...]) -> list[Finding]:
    """A hand on the flange presses the tool onto the block with 55 N: the arm does not stay as it is."""
    arena = _running("wall", without, ticks=1500)
    for newtons in range(0, 56, 1):
        arena.hand_n = np.array([0.0, 0.0, -float(newtons)])
        arena.run(15)
    arena.run(100)
    trace = arena.log.trace
    over = np.flatnonzero(lowpassed(trace, 50.0) > 1.05 * CONFIG.retreat_force_n)
    # The sensor has a low-pass of its own.
    return [
        stopped(trace, "pressed too hard", int(over[0]), 20, RETREAT) if len(over) else Finding("pressed", 1.0, 0.0)
    ]


def moment(without: tuple[str, ...]) -> list[Finding]:
    """A hand twists the flange with 9 N.m about the axis of a peg that leans on the hole's wall."""
    arena = _running("hole", without)
    for newton_metres in np.linspace(0.0, 9.0, 60):
        arena.hand_nm = np.array([0.0, float(newton_metres), 0.0])
        arena.run(40)
    start = arena.log.count
    arena.run(200)
    return [stopped(arena.log.trace, "twisted too hard", start, 20, RETREAT)]


def impact(without: tuple[str, ...]) -> list[Finding]:
    """A hand throws the tool onto the block."""
    arena = _running("wall", without, ticks=300)
    retarget(arena, moved(arena, [0.0, 0.0, -0.04]), 500)
    arena.run(1500)
    arena.hand_n = np.array([0.0, 0.0, -60.0])
    arena.run(600)
    trace = arena.log.trace
    over = np.flatnonzero(lowpassed(trace, 200.0) > 1.1 * CONFIG.impact_force_n)
    if not len(over):
        return [Finding("hit hard enough to see", 1.0, 0.0)]
    return [stopped(trace, "hit", int(over[0]), 20, SOFT_STOP)]


def joint_speed(without: tuple[str, ...]) -> list[Finding]:
    """Something spins the last joint."""
    arena = _running("free", without)
    arena.plant.data.qvel[6] = 0.95 * arena.rig.robot.velocity_rad_s[6]
    start = arena.log.count
    arena.run(300)
    return [stopped(arena.log.trace, "a joint too fast", start, 0, SOFT_STOP)]


def joint_limit(without: tuple[str, ...]) -> list[Finding]:
    """The last joint is asked to turn to its end."""
    arena = _running("free", without, noisy=False)
    trace = arena.log.trace
    for k in range(260):
        # The tool's z points down, so the last joint turns with it.
        retarget(arena, moved(arena, np.zeros(3), np.array([0.0, 0.0, 0.01 * k])), 10)
        arena.run(10)
    arena.run(200)
    trace = arena.log.trace
    q, dq = trace.truth["q"], trace.truth["dq"]
    low, high = np.array(arena.rig.robot.position_min_rad), np.array(arena.rig.robot.position_max_rad)
    margin = CONFIG.joint_margin_rad
    out = ((q > high - margin) & (dq > 0.02)) | ((q < low + margin) & (dq < -0.02))
    first = np.flatnonzero(out.any(1))
    if not len(first):
        return [Finding("no joint came near its end", 1.0, 0.0)]
    return [stopped(trace, "a joint near its end", int(first[0]), 1, SOFT_STOP)]


def _tampered(
    without: tuple[str, ...], name: str, within: int, least: int, make: Callable[[Arena], Callable[[np.ndarray], None]]
) -> list[Finding]:
    arena = _running("wall", without, ticks=1500)
    start = arena.log.count
    arena.tampers["fault"] = make(arena)
    arena.run(within + 20)
    trace = arena.log.trace
    return [*check(arena, trace), stopped(trace, name, start, within, least)]


def overrun(without: tuple[str, ...]) -> list[Finding]:
    """Six milliseconds have passed since the last tick."""

    def make(arena: Arena) -> Callable[[np.ndarray], None]:
        return lambda obs: obs.__setitem__("t_ns", obs["t_ns"] + 6_000_000)

    return _tampered(without, "late", 1, SOFT_STOP, make)


def stale_state(without: tuple[str, ...]) -> list[Finding]:
    """The robot's clock stands still."""

    def make(arena: Arena) -> Callable[[np.ndarray], None]:
        t_ns = int(arena.controller.obs[0]["t_ns"])
        return lambda obs: obs.__setitem__("t_ns", t_ns)

    return _tampered(without, "a clock that stands still", 4, SOFT_STOP, make)


def sensor(without: tuple[str, ...]) -> list[Finding]:
    """The force sensor reads the same to the last bit."""

    def make(arena: Arena) -> Callable[[np.ndarray], None]:
        frozen = arena.controller.obs[0]["wrench"].copy()
        return lambda obs: obs["wrench"].__setitem__(slice(None), frozen)

    return _tampered(without, "a frozen sensor", 22, SOFT_STOP, make)


def emergency_stop(without: tuple[str, ...]) -> list[Finding]:
    """Somebody hits the stop."""
    arena = _running("free", without)
    arena.controller.stop()
    start = arena.log.count
    arena.run(100)
    return [stopped(arena.log.trace, "an emergency stop", start, 0, LATCHED)]


assert RUN < HOLD < RETREAT < SOFT_STOP < LATCHED
STOPS = {
    "silence": silence,
    "plan-end": plan_end,
    "hold-expired": hold_expired,
    "force": force,
    "moment": moment,
    "impact": impact,
    "joint-speed": joint_speed,
    "joint-limit": joint_limit,
    "overrun": overrun,
    "stale-state": stale_state,
    "sensor": sensor,
    "emergency-stop": emergency_stop,
}
