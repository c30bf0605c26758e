"""The long run against the safety layer: every adversary at every place, a search for the worst input, and what held.

Prints a line an adversary (its worst values over all places), a line an invariant, and how often each safeguard acted.
The same seed gives the same tables. Run it as `python benchmarks/safety_invariants.py --ticks 2000000 --workers 2`; it
returns 1 if anything broke, or if there is an invariant that no run checked. What the runs are worth is seen with
`--without tank-stiffness tank-reference tank-torque tank-debt observer`, or any other safeguards: then they break.
"""

import argparse
import sys
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "harness"))

from safety.findings import Finding, unchecked
from safety.runs import Outcome, all_runs, all_searches, all_silences, run
from wrenchflow.control.safeguards import MODES, SAFEGUARDS

# Columns of the first table: what is shown of which finding, and how.
SHOWN = {
    "tank J": ("I1 tank", lambda worst: f"{-worst:.3f}"),
    "work over J": ("I2 work since any tick [J over]", lambda worst: f"{worst:.3f}"),
    "torque": ("I3 torque", lambda worst: f"{worst:.2f}"),
    "rate": ("I3 torque rate", lambda worst: f"{worst:.2f}"),
    "leash N": ("I10 leash [N]", lambda worst: f"{worst:.1f}"),
    "static N": ("I9 static force [N]", lambda worst: f"{worst:.1f}"),
    "pressed N": ("contact quasi-static [N]", lambda worst: f"{worst:.1f}"),
    "impact": ("contact impact [150/s m v]", lambda worst: f"{worst:.2f}"),
}


def worst_by_name(outcomes: list[Outcome]) -> dict[str, tuple[Finding, Outcome]]:
    """The worst finding of each name, and where it was found; one that is broken is worse than any that holds."""
    worst: dict[str, tuple[Finding, Outcome]] = {}
    for outcome in outcomes:
        for each in outcome.findings:
            if each.name not in worst or each.badness > worst[each.name][0].badness:
                worst[each.name] = (each, outcome)
    return worst


def print_adversaries(outcomes: list[Outcome]) -> None:
    """A line an adversary."""
    groups = defaultdict(list)
    for outcome in outcomes:
        groups[outcome.run.adversary].append(outcome)
    print(f"{'adversary':16} {'runs':>5} {'ticks':>8} " + " ".join(f"{name:>11}" for name in SHOWN))
    for adversary, some in groups.items():
        worst = worst_by_name(some)
        cells = []
        for name, show in SHOWN.values():
            finding = worst[name][0]
            cells.append(f"{show(finding.worst) if finding.is_checked else '-':>11}")
        print(f"{adversary:16} {len(some):5} {sum(each.ticks for each in some):8} " + " ".join(cells))


def print_invariants(outcomes: list[Outcome]) -> bool:
    """A line an invariant; returns whether all were checked, and hold."""
    nowhere = unchecked(each for outcome in outcomes for each in outcome.findings)
    print()
    broken_at_all = False
    for name, (finding, outcome) in sorted(worst_by_name(outcomes).items()):
        if name in nowhere:
            print(f"{'not checked':15} {name}")
            continue
        broken = sum(not each.holds for some in outcomes for each in some.findings if each.name == name)
        broken_at_all = broken_at_all or broken > 0
        verdict = f"FAIL in {broken} runs" if broken else "pass"
        worst = f"{finding.worst:.6g} of {finding.limit:.6g}"
        print(f"{verdict:15} {name:40} {worst:28} {outcome.run}, tick {finding.tick}")
    return not nowhere and not broken_at_all


def print_broken(outcomes: list[Outcome]) -> None:
    """Every run in which something broke, so that it can be run again."""
    broken = [each for each in outcomes if each.broken]
    if broken:
        print(f"\nbroken in {len(broken)} runs, of {len({each.run.adversary for each in broken})} adversaries:")
    for outcome in broken:
        # What is left out is the same in all of them.
        print(f"{replace(outcome.run, without=())}: " + "; ".join(str(each) for each in outcome.broken))


def print_counts(outcomes: list[Outcome]) -> None:
    """Ticks in each mode, and how often each safeguard acted, over all runs; one that never did was not tried."""
    modes = dict(zip(MODES, sum(each.modes for each in outcomes).tolist(), strict=True))
    acted = dict(zip(SAFEGUARDS, sum(each.interventions for each in outcomes).tolist(), strict=True))
    print("\nticks in each mode: " + ", ".join(f"{name} {ticks}" for name, ticks in modes.items()))
    print("ticks with an intervention: " + ", ".join(f"{name} {ticks}" for name, ticks in acted.items() if ticks))
    print("never: " + (", ".join(name for name, ticks in acted.items() if not ticks) or "none"))


def main() -> int:
    """Run everything and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=2_000_000)
    parser.add_argument("--ticks-a-run", type=int, default=3000)
    parser.add_argument("--searched", type=float, default=0.1, help="share of the ticks that the search gets")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--without", nargs="*", default=[], choices=list(SAFEGUARDS), help="safeguards to leave out")
    given = parser.parse_args()
    searched = int(given.ticks * given.searched)
    runs = [
        *all_runs(given.ticks - searched, given.ticks_a_run, given.seed),
        *(all_searches(searched, given.seed) if searched else ()),
        *all_silences(given.seed),
    ]
    runs = [replace(each, without=tuple(given.without)) for each in runs]
    with ProcessPoolExecutor(given.workers) as pool:
        outcomes = list(pool.map(run, runs))
    print_adversaries(outcomes)
    holds = print_invariants(outcomes)
    print_broken(outcomes)
    print_counts(outcomes)
    verdict = "all checked, all hold" if holds else "NOT all checked and held"
    print(f"\n{sum(each.ticks for each in outcomes)} ticks in {len(outcomes)} runs: {verdict}")
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
