"""What the safety layer does to tasks without faults: the same seeds with it and without it, operators and a policy.

Prints, for each who acts: success with and without the layer, the difference with its one-sided 95 % bound (it must not
cost more than three points), the share of ticks in which nothing intervened, what intervened, and how long the leash
was active; for a policy also on a leash of 60 N. Run it as
`python benchmarks/safety_worth.py --seeds 1000 --run RUN --jobs 2`.
"""

import argparse
import math
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import batched
from pathlib import Path

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import OPERATORS, demonstrate
from wrenchflow.control.safeguards import SAFEGUARDS
from wrenchflow.deploy.config import DeployConfig
from wrenchflow.deploy.evaluation import Verdict, judge, wilson_interval
from wrenchflow.episode import Episode
from wrenchflow.ledger import STREAM
from wrenchflow.sim.attempt import EVALUATE
from wrenchflow.sim.tasks import scenery

MARGIN = 0.03
Z = 1.645  # One-sided, 95 %.
LONG_LEASH_N = 60.0


@dataclass(frozen=True)
class Result:
    """One attempt: how it went, and what the layer did."""

    verdict: Verdict
    ticks: int
    untouched: int
    interventions: dict[str, int]


def seen(episode: Episode, config: DeployConfig) -> Result:
    """The result of a recorded attempt."""
    acting = episode[STREAM].column("acting")
    interventions = episode.meta["safety"]["interventions"]
    return Result(judge(episode, config), len(acting), int((acting == 0.0).sum()), interventions)


def operated(indices: Sequence[int], operator: str, without: tuple[str, ...]) -> list[Result]:
    """Attempts of an operator."""
    config, limits = CollectConfig(operator=operator), DeployConfig()
    return [seen(demonstrate(i, config, scenes=EVALUATE, without=without), limits) for i in indices]


def deployed(indices: Sequence[int], run: Path, force_max_n: float, without: tuple[str, ...]) -> list[Result]:
    """Attempts of a policy."""
    import torch

    from wrenchflow.deploy.rollout import roll_out
    from wrenchflow.policy.checkpoint import load_policy

    torch.set_num_threads(1)
    base = DeployConfig()
    limits = replace(
        base.control, force_max_n=force_max_n, retreat_force_n=max(base.control.retreat_force_n, force_max_n)
    )
    config = replace(base, control=limits)
    task, rig, model = scenery(config.task, config.rig)
    return [
        seen(each, config) for each in roll_out(indices, load_policy(run), task, model, rig, config, without=without)
    ]


def rate(results: Sequence[Result]) -> str:
    """Success with Wilson's interval."""
    successes = sum(each.verdict.success for each in results)
    low, high = wilson_interval(successes, len(results))
    return f"{successes / len(results):.1%} [{low:.1%}, {high:.1%}]"


def compare(name: str, governed: Sequence[Result], bare: Sequence[Result]) -> bool:
    """Print how two arms on the same seeds compare; returns whether the first is not worse by the margin."""
    n = len(governed)
    pairs = [(a.verdict.success, b.verdict.success) for a, b in zip(governed, bare, strict=True)]
    won, lost = pairs.count((True, False)) / n, pairs.count((False, True)) / n
    worst = lost - won + Z * math.sqrt(max(won + lost - (won - lost) ** 2, 0.0) / n)
    holds = worst < MARGIN
    print(
        f"{name}: with the layer {rate(governed)}, without {rate(bare)}; lost {lost - won:+.1%}, at most {worst:.1%} "
        f"(one-sided 95 %, goal {MARGIN:.0%}: {'holds' if holds else 'MISSED'})"
    )
    return holds


def describe(name: str, results: Sequence[Result]) -> None:
    """Print what the layer did."""
    ticks = sum(each.ticks for each in results)
    acted = Counter[str]()
    for each in results:
        acted.update(each.interventions)
    leash = sum(each.verdict.leash_share for each in results) / len(results)
    peaks = sorted(each.verdict.peak_force_n for each in results)
    told = ", ".join(f"{key} {count / ticks:.2%}" for key, count in acted.most_common(8))
    print(
        f"{name}: {rate(results)}; nothing intervened in {sum(each.untouched for each in results) / ticks:.1%} of "
        f"{ticks} ticks; leash active in {leash:.2%}; peak force {peaks[len(peaks) // 2]:.1f} N median, "
        f"{peaks[int(0.95 * len(peaks))]:.1f} N at 95 %; {told}"
    )


def main() -> int:
    """Run everything and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=1000)
    parser.add_argument("--run", type=Path, default=None)
    parser.add_argument("--jobs", type=int, default=1)
    given = parser.parse_args()
    nothing, all_of_it = (), tuple(SAFEGUARDS)
    holds = True
    with ProcessPoolExecutor(given.jobs) as pool:

        def gather(work: Callable[[Sequence[int]], list[Result]]) -> list[Result]:
            parts: Iterable[list[Result]] = pool.map(work, batched(range(given.seeds), 25))
            return [each for part in parts for each in part]

        for operator in OPERATORS:
            arms = [gather(partial(operated, operator=operator, without=out)) for out in (nothing, all_of_it)]
            holds &= compare(operator, *arms)
            describe(operator, arms[0])
        if given.run is not None:
            work = partial(deployed, run=given.run)
            default = DeployConfig().control.force_max_n
            arms = [gather(partial(work, force_max_n=default, without=out)) for out in (nothing, all_of_it)]
            holds &= compare("policy", *arms)
            describe(f"policy, leash {default:g} N", arms[0])
            describe(
                f"policy, leash {LONG_LEASH_N:g} N", gather(partial(work, force_max_n=LONG_LEASH_N, without=nothing))
            )
    return 0 if holds else 1


if __name__ == "__main__":
    raise SystemExit(main())
