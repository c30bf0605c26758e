"""The long run against the safety layer: every adversary at every place, a search for the worst input, and what held.

Prints a table of runs (place and adversary: ticks, modes, worst values, interventions), and a line an invariant. The
same seed gives the same table. Run it as `python benchmarks/safety_invariants.py --ticks 2000000 --workers 2`; it
returns 1 if anything broke.
"""

import argparse
import sys
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "harness"))

from safety.findings import Finding
from safety.runs import Outcome, all_runs, all_searches, run
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


def print_runs(outcomes: list[Outcome]) -> None:
    """A line a place and adversary."""
    groups = defaultdict(list)
    for outcome in outcomes:
        groups[outcome.run.place, outcome.run.adversary].append(outcome)
    print(
        f"{'place':8} {'adversary':16} {'ticks':>8}  "
        + " ".join(f"{name:>11}" for name in SHOWN)
        + "  modes, interventions"
    )
    for (place, adversary), some in groups.items():
        worst = worst_by_name(some)
        cells = []
        for name, show in SHOWN.values():
            value = worst[name][0].worst
            cells.append(f"{'-' if value == float('-inf') else show(value):>11}")
        modes = "/".join(mode for mode, ticks in zip(MODES, sum(each.modes for each in some), strict=True) if ticks)
        acted = Counter(dict(zip(SAFEGUARDS, sum(each.interventions for each in some).tolist(), strict=True)))
        told = ", ".join(f"{name} {ticks}" for name, ticks in acted.most_common() if ticks)
        ticks = sum(each.ticks for each in some)
        print(f"{place:8} {adversary:16} {ticks:8}  " + " ".join(cells) + f"  {modes}; {told}")


def print_invariants(outcomes: list[Outcome]) -> bool:
    """A line an invariant; returns whether all hold."""
    print()
    holds = True
    for name, (finding, outcome) in sorted(worst_by_name(outcomes).items()):
        broken = sum(not each.holds for some in outcomes for each in some.findings if each.name == name)
        holds = holds and broken == 0
        verdict = "pass" if broken == 0 else f"FAIL in {broken} runs"
        worst = f"worst {finding.worst:.6g} of {finding.limit:.6g}"
        print(f"{verdict:16} {name:40} {worst}  ({outcome.run}, tick {finding.tick})")
    return holds


def print_broken(outcomes: list[Outcome]) -> None:
    """Every run in which something broke, so that it can be run again."""
    for outcome in outcomes:
        for each in outcome.broken:
            print(f"{outcome.run}: {each}")


def print_safeguards(outcomes: list[Outcome]) -> None:
    """How often each safeguard acted, over all runs; one that never did was not tried."""
    acted = dict(zip(SAFEGUARDS, sum(each.interventions for each in outcomes).tolist(), strict=True))
    print("\nticks with an intervention: " + ", ".join(f"{name} {ticks}" for name, ticks in acted.items()))
    print("never: " + (", ".join(name for name, ticks in acted.items() if not ticks) or "none"))


def main() -> int:
    """Run everything and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--ticks", type=int, default=2_000_000)
    parser.add_argument("--ticks-a-run", type=int, default=3000)
    parser.add_argument("--searched", type=float, default=0.1, help="share of the ticks that the search gets")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    searched = int(given.ticks * given.searched)
    runs = [
        *all_runs(given.ticks - searched, given.ticks_a_run, given.seed),
        *(all_searches(searched, given.seed) if searched else ()),
    ]
    with ProcessPoolExecutor(given.workers) as pool:
        outcomes = list(pool.map(run, runs))
    print_runs(outcomes)
    holds = print_invariants(outcomes)
    print_broken(outcomes)
    print_safeguards(outcomes)
    print(
        f"\n{sum(each.ticks for each in outcomes)} ticks in {len(outcomes)} runs: {'all hold' if holds else 'BROKEN'}"
    )
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
