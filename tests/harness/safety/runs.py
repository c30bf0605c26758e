"""Many runs: every adversary at every place, and the search for the worst input; what came of each, as numbers."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from safety.adversaries import ADVERSARIES, operator, scripts_of
from safety.arena import PLACES, Arena
from safety.checks import check
from safety.findings import Finding
from safety.search import GENES, search, tuned
from safety.trace import Trace
from wrenchflow.control.config import ControlConfig
from wrenchflow.control.safeguards import MODES, SAFEGUARDS

# Rises faster than by default, so that less of a run is spent on it.
NOISY = ControlConfig(ramp_s=0.2)
PERFECT = replace(NOISY, nullspace_nm_rad=0.0)
WAITS = 100
SEARCHED = "searched"
# What the search makes as bad as it can.
AIMS = ("I2 work since any tick [J over]", "I1 tank", "contact impact [150/s m v]", "contact quasi-static [N]")


@dataclass(frozen=True, kw_only=True)
class Run:
    """One adversary at one place."""

    place: str
    adversary: str
    seed: int
    ticks: int
    noisy: bool

    def __str__(self) -> str:
        return f"{self.adversary} at {self.place}, seed {self.seed}{'' if self.noisy else ', perfect measurement'}"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What came of a run.

    Attributes:
        run: Which.
        findings: Every invariant.
        ticks: Looked at.
        modes: Ticks in each mode.
        interventions: Ticks in which each safeguard intervened.
    """

    run: Run
    findings: tuple[Finding, ...]
    ticks: int
    modes: np.ndarray
    interventions: np.ndarray

    @property
    def broken(self) -> list[Finding]:
        """What does not hold."""
        return [each for each in self.findings if not each.holds]


Counts = tuple[int, np.ndarray, np.ndarray]


def _counts(trace: Trace) -> Counts:
    modes = np.bincount(trace.after["mode"], minlength=len(MODES))
    acting = trace.after["acting"]
    return len(trace), modes, np.array([(acting >> number & 1).sum() for number in range(len(SAFEGUARDS))])


def _outcome(run: Run, findings: list[Finding], counted: list[Counts]) -> Outcome:
    ticks, modes, interventions = (sum(part[1:], part[0]) for part in zip(*counted, strict=True))
    return Outcome(run=run, findings=tuple(findings), ticks=ticks, modes=modes, interventions=interventions)


def play(run: Run) -> Outcome:
    """Let one adversary loose."""
    arena = _arena(run)
    trace = arena.play(*scripts_of(arena, run.adversary, run.seed), ticks=run.ticks - WAITS)
    return _outcome(run, check(arena, trace), [_counts(trace)])


def play_search(run: Run, ticks: int = 750) -> Outcome:
    """Search for the worst input at one place, with `ticks` ticks an attempt."""
    counted: list[Counts] = []
    findings: list[Finding] = []

    def attempt(genes: np.ndarray, seed: int) -> list[Finding]:
        arena = _arena(replace(run, seed=seed))
        scripts = tuned(arena, genes), operator(arena, np.random.default_rng((seed, GENES)))
        trace = arena.play(*scripts, ticks=ticks - WAITS)
        found = check(arena, trace)
        counted.append(_counts(trace))
        findings.extend(found)
        return found

    attempts = max(2, run.ticks // ticks // len(AIMS))
    for number, aim in enumerate(AIMS):
        rng = np.random.default_rng((run.seed, 31, number))
        search(attempt, aim, rng, draws=attempts // 2, refinements=attempts - attempts // 2)
    return _outcome(run, _worst(findings), counted)


def _worst(findings: list[Finding]) -> list[Finding]:
    worst: dict[str, Finding] = {}
    for each in findings:
        if each.name not in worst or each.badness > worst[each.name].badness:
            worst[each.name] = each
    return list(worst.values())


def _arena(run: Run) -> Arena:
    return Arena(run.place, run.seed, noisy=run.noisy, control=NOISY if run.noisy else PERFECT, waits=WAITS)


def all_runs(ticks: int, ticks_a_run: int, seed: int) -> Iterator[Run]:
    """Runs of every adversary at every place, every third with a perfect measurement, until `ticks` are spent."""
    spent, number = 0, 0
    while spent < ticks:
        for place, adversary in product(PLACES, ADVERSARIES):
            noisy = number % 3 != 0
            yield Run(place=place, adversary=adversary, seed=seed + number, ticks=ticks_a_run, noisy=noisy)
            spent, number = spent + ticks_a_run, number + 1


def all_searches(ticks: int, seed: int) -> Iterator[Run]:
    """A search at every place, of `ticks` ticks together."""
    for number, place in enumerate(PLACES):
        yield Run(place=place, adversary=SEARCHED, seed=seed + number, ticks=ticks // len(PLACES), noisy=True)


def run(each: Run) -> Outcome:
    """Either of the two."""
    return play_search(each) if each.adversary == SEARCHED else play(each)
