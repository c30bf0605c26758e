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
_ACTS_EVERY = 5  # ticks
_EYE = np.eye(3)


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
        along = twist[:3] / max(math.hypot(*twist[:3]), 1e-3)
        around = twist[3:] / max(math.hypot(*twist[3:]), 1e-2)
        wave = math.sin(2.0 * math.pi * now / period)
        turned = math.copysign(1.0, math.sin(2.0 * math.pi * now / turn_period))
        pose = moved(arena, swing_m * wave * line, turn_rad * turned * axis)
        pose[:3] += lead_m * along
        retarget(arena, pose, _ACTS_EVERY)
        drives = float(ctl["e"] @ twist) > 0.0 if follows else math.sin(2.0 * math.pi * now / period + phase) > 0.0
        req["K_lin"] = _EYE * (stiff if drives else soft)
        req["K_rot"] = _EYE * (stiff if drives else soft) * 0.04
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
    """

    genes: np.ndarray
    seed: int
    finding: Finding


def search(
    attempt: Callable[[np.ndarray, int], list[Finding]],
    aim: str,
    rng: Generator,
    *,
    draws: int,
    refinements: int,
) -> Worst:
    """Look for the genes that bring one finding nearest to its limit, or furthest over it.

    Args:
        attempt: Takes genes and a seed, and returns the findings of a run.
        aim: Name of the finding.
        rng: Every random number.
        draws: Attempts with genes drawn at random, 1 at least.
        refinements: Attempts with the worst genes changed a little, by ever smaller steps.
    """
    worst, spread = None, 0.25
    for k in range(draws + refinements):
        seed, genes = int(rng.integers(1 << 31)), rng.random(GENES)
        if worst is not None and k >= draws:
            chosen = rng.random(GENES) < 0.4
            genes = np.clip(worst.genes + spread * chosen * rng.normal(size=GENES), 0.0, 1.0)
        mine = next(each for each in attempt(genes, seed) if each.name == aim)
        if worst is None or mine.badness > worst.finding.badness:
            worst = Worst(genes, seed, mine)
        elif k >= draws:
            spread = max(0.02, 0.9 * spread)
    assert worst is not None, "a search draws at least once"
    return worst
