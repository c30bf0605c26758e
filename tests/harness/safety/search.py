"""A search for the worst input: an adversary of sixteen numbers, drawn at random, then the worst of them made worse."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from safety.adversaries import Script, moved, retarget, seen_twist
from safety.arena import Arena
from safety.findings import Finding

GENES = 16
_ACTS_EVERY = 2  # ticks


def _between(gene: float, low: float, high: float) -> float:
    """A gene as a number from `low` to `high`, on a logarithmic scale."""
    return low * (high / low) ** gene


def _direction(azimuth: float, height: float) -> np.ndarray:
    z = 2.0 * height - 1.0
    r, angle = math.sqrt(max(0.0, 1.0 - z * z)), 2.0 * math.pi * azimuth
    return np.array([r * math.cos(angle), r * math.sin(angle), z])


def tuned(arena: Arena, genes: np.ndarray) -> Script:
    """An adversary that swings the target, leads the motion, and changes gains with the phase of either.

    Args:
        arena: Where.
        genes: From 0 to 1. Shape (GENES,).
    """
    g = np.clip(genes, 0.0, 1.0)
    line, axis = _direction(g[0], g[1]), _direction(g[2], g[3])
    swing_m, turn_rad = _between(g[4], 1e-3, 0.3), _between(g[5], 1e-3, 0.6)
    period, turn_period = _between(g[6], 20.0, 2000.0), _between(g[7], 20.0, 2000.0)
    lead_m = _between(g[8], 1e-4, 0.1)
    stiff, soft = _between(g[9], 50.0, 3000.0), _between(g[10], 50.0, 3000.0)
    phase, damped = 2.0 * math.pi * g[11], _between(g[12], 0.1, 5.0)
    force_n, moment_nm, follows = _between(g[13], 0.1, 60.0), _between(g[14], 0.01, 6.0), g[15] > 0.5
    now = 0
    while True:
        twist, req, ctl = seen_twist(arena), arena.controller.req[0], arena.controller.ctl[0]
        along = twist[:3] / max(float(np.linalg.norm(twist[:3])), 1e-3)
        around = twist[3:] / max(float(np.linalg.norm(twist[3:])), 1e-2)
        wave = math.sin(2.0 * math.pi * now / period)
        turned = math.copysign(1.0, math.sin(2.0 * math.pi * now / turn_period))
        pose = moved(arena, swing_m * wave * line, turn_rad * turned * axis)
        pose[:3] += lead_m * along
        retarget(arena, pose, _ACTS_EVERY)
        drives = float(ctl["e"] @ twist) > 0.0 if follows else math.sin(2.0 * math.pi * now / period + phase) > 0.0
        req["K_lin"] = np.eye(3) * (stiff if drives else soft)
        req["K_rot"] = np.eye(3) * (stiff if drives else soft) * 0.04
        req["damping_ratio"] = 0.1 if drives else damped
        req["wrench"] = np.concatenate([force_n * along, moment_nm * around])
        now += _ACTS_EVERY
        yield _ACTS_EVERY


@dataclass(frozen=True)
class Worst:
    """The worst input that was found, and what it did.

    Attributes:
        genes: Of `tuned`. Shape (GENES,).
        seed: Of the arena.
        finding: Of the invariant that was searched for.
        broken: Every finding of any run that did not hold, the search's own aim or not.
        ticks: How many ticks were looked at.
    """

    genes: np.ndarray
    seed: int
    finding: Finding
    broken: tuple[Finding, ...]
    ticks: int


def search(
    run: Callable[[np.ndarray, int], list[Finding]],
    aim: str,
    rng: Generator,
    *,
    draws: int,
    refinements: int,
    ticks: int,
) -> Worst:
    """Look for the genes that bring one finding nearest to, or furthest over, its limit.

    Args:
        run: Takes genes and a seed, and returns the findings of a run.
        aim: Name of the finding.
        rng: Every random number.
        draws: Runs with genes drawn at random.
        refinements: Runs with the worst genes changed a little, with ever smaller steps.
        ticks: Of one run, for the count.
    """
    worst, broken, spread = None, [], 0.25
    for k in range(draws + refinements):
        seed = int(rng.integers(1 << 31))
        if k < draws or worst is None:
            genes = rng.random(GENES)
        else:
            genes = np.clip(worst.genes + spread * rng.normal(size=GENES) * (rng.random(GENES) < 0.4), 0.0, 1.0)
        found = run(genes, seed)
        broken += [each for each in found if not each.holds]
        mine = next(each for each in found if each.name == aim)
        if worst is None or not mine.worst <= worst.finding.worst:
            worst = Worst(genes, seed, mine, (), 0)
        elif k >= draws:
            spread = max(0.02, 0.9 * spread)
    assert worst is not None
    return Worst(worst.genes, worst.seed, worst.finding, tuple(broken), ticks * (draws + refinements))
