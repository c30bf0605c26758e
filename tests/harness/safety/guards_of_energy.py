"""Scenarios of what guards energy: a tank that is all but empty, a hand that loads the spring, a law that is wrong."""

from dataclasses import replace

import numpy as np

from safety.adversaries import Script, moved, retarget, seen_twist
from safety.arena import Arena
from safety.checks import check
from safety.energy import check_tank, check_work
from safety.findings import Finding
from wrenchflow.control.config import ControlConfig

# Next to nothing in the tank, and nothing that comes in.
POOR = ControlConfig(ramp_s=0.05, tank_start_j=0.1, tank_fill_w=0.0)
# An arm without a nullspace spring, whose work the tank would pay for.
POORER = replace(POOR, nullspace_nm_rad=0.0)


def _held(without: tuple[str, ...], config: ControlConfig = POORER) -> Arena:
    """An arm that somebody has pulled 10 cm away from its target, with a soft spring, and holds there."""
    arena = Arena("free", 1, noisy=False, control=config, without=without)
    arena.controller.req[0]["K_lin"] = np.eye(3) * 100.0
    retarget(arena, arena.base_target, 1)
    arena.run(1200)
    arena.hand_n = np.array([10.0, 0.0, 0.0])
    arena.run(1500)
    return arena


def tank_stiffness(without: tuple[str, ...]) -> list[Finding]:
    """The spring that a hand has loaded is asked to be ten times as stiff: the tank cannot pay for all of that."""
    arena = _held(without)
    arena.controller.req[0]["K_lin"] = np.eye(3) * 1000.0
    arena.run(1500)
    return check(arena, arena.log.trace)


def tank_reference(without: tuple[str, ...]) -> list[Finding]:
    """The target goes on, away from the hand that holds the arm."""
    arena = _held(without)
    retarget(arena, moved(arena, arena_away(arena)), 1000)
    arena.run(1500)
    return check(arena, arena.log.trace)


def arena_away(arena: Arena) -> np.ndarray:
    """Ten centimetres against the hand, in the target's axes."""
    along = arena.controller.obs[0]["R"].T @ arena.hand_n
    return -0.1 * along / np.linalg.norm(along)


def _fed_along(arena: Arena, force_n: float) -> Script:
    while True:
        velocity = seen_twist(arena)[:3]
        along = velocity / max(float(np.linalg.norm(velocity)), 1e-3)
        arena.controller.req[0]["wrench"] = np.concatenate([force_n * along, np.zeros(3)])
        yield 2


def tank_torque(without: tuple[str, ...]) -> list[Finding]:
    """Feed-forward that always pushes where the arm is going, and next to nothing to pay for it."""
    arena = Arena("free", 1, noisy=False, control=POORER, without=without)
    retarget(arena, moved(arena, [0.02, 0.0, 0.0]), 50)
    trace = arena.play(_fed_along(arena, 20.0), ticks=2500)
    return check(arena, trace)


def _driven(without: tuple[str, ...], config: ControlConfig) -> Arena:
    """A robot whose model is wrong, so that what should cancel Coriolis torque drives it, against somebody's hand."""
    arena = Arena("free", 1, noisy=False, control=config, without=without)
    retarget(arena, moved(arena, [0.02, 0.0, 0.0]), 50)
    arena.run(100)
    arena.tampers["model"] = lambda obs: np.add(obs["coriolis"], 7.0 * obs["dq"], out=obs["coriolis"])
    arena.play(_braking_hand(arena), ticks=2500)
    return arena


def _braking_hand(arena: Arena) -> Script:
    while True:
        arena.hand_n = -10.0 * seen_twist(arena)[:3]
        yield 1


def tank_debt(without: tuple[str, ...]) -> list[Finding]:
    """Nobody is asked before such a torque is paid for: the tank is not overdrawn, the spring pays."""
    return check_tank(_driven(without, POORER).log.trace)


def observer(without: tuple[str, ...]) -> list[Finding]:
    """Nothing can pay for it any more: no more work is done than was budgeted, or hardly."""
    arena = _driven(without, ControlConfig(ramp_s=0.05))
    # It has to see the damage: until it has latched the arm, and torque has changed at its rate, this much is done.
    return check_work(arena.log.trace, arena.config, 1.0, 0.0)


ENERGY = {
    "tank-stiffness": tank_stiffness,
    "tank-reference": tank_reference,
    "tank-torque": tank_torque,
    "tank-debt": tank_debt,
    "observer": observer,
}
