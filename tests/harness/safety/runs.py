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
# The default tank never runs dry in a run; what may be asked for soon empties this one down to its reserve.
POOR_TANK = {"tank_start_j": 0.08, "tank_max_j": 0.1, "tank_reserve_j": 0.05, "tank_fill_w": 0.005}
WAITS = 100
SEARCHED = "searched"
# What a search makes as bad as it can: energy where there is hardly any, and forces where nothing else is in the way.
ENERGY_AIMS = ("I1 tank", "I2 work since any tick [J over]")
FORCE_AIMS = ("contact impact [150/s m v]", "contact quasi-static [N]")
# The last request, what it takes to expire, and the three seconds until the arm has to be at rest.
SILENT_TICKS = 4200


@dataclass(frozen=True, kw_only=True)
class Run:
    """One adversary at one place.

    Attributes:
        place: Of `PLACES`.
        adversary: Of `ADVERSARIES`, or `SEARCHED`.
        seed: Of everything that is drawn.
        ticks: How long, all attempts of a search together.
        noisy: Whether the arm is measured as a real one is.
        poor: Whether the tank is `POOR_TANK`.
        without: Safeguards that are left out, by name.
    """

    place: str
    adversary: str
    seed: int
    ticks: int
    noisy: bool
    poor: bool
    without: tuple[str, ...] = ()

    def __str__(self) -> str:
        parts = [f"{self.adversary} at {self.place}", f"seed {self.seed}"]
        parts += ["poor tank"] * self.poor + ["perfect measurement"] * (not self.noisy)
        return ", ".join(parts + ["without " + " and ".join(self.without)] * bool(self.without))


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

    aims = ENERGY_AIMS if run.poor else FORCE_AIMS
    attempts = max(2, run.ticks // ticks // len(aims))
    for number, aim in enumerate(aims):
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
    control = NOISY if run.noisy else PERFECT
    if run.poor:
        control = replace(control, **POOR_TANK)
    return Arena(run.place, run.seed, noisy=run.noisy, control=control, without=run.without, waits=WAITS)


def all_runs(ticks: int, ticks_a_run: int, seed: int) -> Iterator[Run]:
    """Runs of every adversary at every place, round after round, until `ticks` are spent.

    Every third has a perfect measurement, two of five have a poor tank; so all four come together in time.
    """
    spent, number = 0, 0
    while spent < ticks:
        for place, adversary in product(PLACES, ADVERSARIES):
            noisy, poor = number % 3 != 0, number % 5 < 2
            yield Run(place=place, adversary=adversary, seed=seed + number, ticks=ticks_a_run, noisy=noisy, poor=poor)
            spent, number = spent + ticks_a_run, number + 1


def all_silences(seed: int) -> Iterator[Run]:
    """A run at every place that lasts until an arm to which nobody speaks has to be at rest."""
    for number, place in enumerate(PLACES):
        noisy, poor = number % 2 == 0, number >= len(PLACES) // 2
        yield Run(place=place, adversary="last words", seed=seed + number, ticks=SILENT_TICKS, noisy=noisy, poor=poor)


def all_searches(ticks: int, seed: int) -> Iterator[Run]:
    """Two searches at every place, with a poor tank and without, of `ticks` ticks together."""
    pairs = list(product(PLACES, (False, True)))
    for number, (place, poor) in enumerate(pairs):
        yield Run(place=place, adversary=SEARCHED, seed=seed + number, ticks=ticks // len(pairs), noisy=True, poor=poor)


def run(each: Run) -> Outcome:
    """Whichever it is."""
    return play_search(each) if each.adversary == SEARCHED else play(each)
