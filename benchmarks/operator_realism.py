"""What the emulated people are like: success, spread between them, submovements, spectra; beside a real hand's.

Prints tables, and with `--page OUT.html` writes a page with the figure of docs/operators.png. The real hand is the
hand-guided recording `17_symbol_data.mat` (AutoLabModena/Panda-Co-Manipulation-Dataset), named with `--real`.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from operator_figure import REAL, SPREAD, figure_of
from operator_takes import Take, real_takes, take_of
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.profiles import PROFILES
from wrenchflow.collect.session import demonstrate
from wrenchflow.episodes_map import map_episodes
from wrenchflow.pages.drawing import Drawing
from wrenchflow.pages.page import page, section
from wrenchflow.pages.plot_block import plot_block

EPISODES, GOAL = 40, 0.2
Told = Mapping[str, Sequence[Mapping[str, float]]]


@dataclass(frozen=True)
class _Try:
    """One demonstration to a take; an object, so that it travels to a worker process."""

    config: CollectConfig

    def __call__(self, index: int) -> Take:
        return take_of(demonstrate(index, self.config))


def wilson(done: int, of: int, z: float = 1.96) -> tuple[float, float]:
    """Interval of a share, 95 %."""
    share, spread = done / of, z * z / of
    middle, half = share + spread / 2, z * np.sqrt(share * (1 - share) / of + spread / (4 * of))
    return (middle - half) / (1 + spread), (middle + half) / (1 + spread)


def spread_of(told: Told, name: str) -> tuple[float, float]:
    """Coefficients of variation: of the means of people, and of all takes."""
    means = np.array([np.nanmean([each[name] for each in those]) for those in told.values()])
    every = np.array([each[name] for those in told.values() for each in those])
    return abs(means.std(ddof=1) / means.mean()), abs(np.nanstd(every, ddof=1) / np.nanmean(every))


def show(takes: Mapping[str, Sequence[Take]], told: Told) -> None:
    """Print the tables."""
    people = {who: those for who, those in told.items() if who != REAL}
    print(f"{'success':22}" + "".join(f"{who:>10}" for who in people))
    shares = {who: [take.success for take in takes[who]] for who in people}
    print(f"{'':22}" + "".join(f"{sum(done):>6}/{len(done):<3}" for done in shares.values()))
    done, of = sum(sum(each) for each in shares.values()), sum(len(each) for each in shares.values())
    low, high = wilson(done, of)
    print(f"all: {done} of {of}, {done / of:.1%} (95 % interval {low:.1%} to {high:.1%})\n")
    head = "".join(f"{who:>10}" for who in told)
    print(f"{'mean of takes':22}{head}   variation between people, of all takes")
    for name in next(iter(people.values()))[0]:
        means = [np.nanmean([each[name] for each in those]) for those in told.values()]
        between, every = spread_of(people, name)
        verdict = f"  (goal {GOAL:g})" if name in SPREAD else ""
        print(f"{name:22}" + "".join(f"{mean:10.3g}" for mean in means) + f"   {between:.2f}, {every:.2f}{verdict}")


def main() -> None:
    """Record, measure, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", default="peg-insertion")
    parser.add_argument("--operator", default="emulated", help="emulated, or hand-guided")
    parser.add_argument("--episodes", type=int, default=EPISODES, help="of each person")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--real", type=Path, help="the hand-guided recording, 17_symbol_data.mat")
    parser.add_argument("--page", type=Path, help="where the page with the figure goes")
    arguments = parser.parse_args()
    config = CollectConfig(task=arguments.task, operator=arguments.operator, profiles=tuple(PROFILES))
    count = arguments.episodes * len(PROFILES)
    recorded = map_episodes(_Try(config), range(count), jobs=arguments.jobs)
    takes: dict[str, list[Take]] = {who: [] for who in PROFILES}
    for take in tqdm(recorded, total=count, disable=None):
        takes[take.who].append(take)
    if arguments.real:
        takes[REAL] = real_takes(arguments.real)
    told = {who: [take.figures() for take in those] for who, those in takes.items()}
    print(f"{arguments.task}, {arguments.operator} people, {arguments.episodes} episodes each")
    show(takes, told)
    if arguments.page:
        figure = section("", plot_block(Drawing(**figure_of(takes, told).to_plotly_json()), "operators"))
        arguments.page.write_text(page(f"Emulated people: {arguments.task}", [figure], ""))


if __name__ == "__main__":
    main()
