"""How many planted faults `process` finds, and how many it finds where there are none.

    python benchmarks/anomaly_detection.py --clean 400 --planted 200

Emulated people do the three tasks; each kind of fault is planted into demonstrations of its own, with a size from the
declared smallest one up, at a place by chance. Everything goes through `look_at`, the very code of the stage: what a
fault does to bias and contact counts. A wrong payload is planted into calibration motions, too, which turn the tool.

Recall of a kind: the share of its episodes in which it is found. Precision of a kind: of all episodes, clean and with
any fault, in which it is found, the share in which it is there. Findings that follow from a planted fault, such as a
bias that cannot be told of a saturated reading, are listed beside.
"""

import argparse
import sys
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "harness"))
from force.planted import FAULTS
from wrenchflow.collect.calibration_motion import run_motion
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import demonstrate
from wrenchflow.episode import Episode
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.pipeline import look_at
from wrenchflow.rig import load_rig

TASKS = ("peg-insertion", "surface-wiping", "connector-insertion")
PAYLOAD = "wrong-payload"
# What says only that something else keeps the force from being cleaned.
FOLLOWS = {"no-clean-force", "always-loaded", "no-contact"}


def episode_of(number: int, seed: int, kind: str) -> Episode:
    """A demonstration, or for the payload a calibration motion."""
    if kind == PAYLOAD:
        rig = load_rig("panda_peg")
        return run_motion(rig, rig.payload, seed=seed + number)
    task = TASKS[number % len(TASKS)]
    return demonstrate(number // len(TASKS), CollectConfig(task=task, operator="emulated", seed=seed))


def found_in(seed: int, wanted: tuple[int, str]) -> tuple[str, list[str], str]:
    """The kinds that are found in one episode, clean if `kind` is empty; and why the kind cannot be told."""
    number, kind = wanted
    episode = episode_of(number, seed, kind)
    if kind:
        episode = FAULTS[kind](episode, np.random.default_rng([seed, number, sorted(FAULTS).index(kind)]))
    # A calibration motion touches nothing.
    config = ProcessConfig(expects_contact=kind != PAYLOAD)
    _, assessment = look_at(episode, config)
    why = next((each.reason for each in assessment.not_assessed if each.kind == kind), "")
    return kind, sorted({finding.kind for finding in assessment.findings}), why


def main() -> None:
    """Plant, look, and print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--clean", type=int, default=400)
    parser.add_argument("--planted", type=int, default=200)
    parser.add_argument("--seed", type=int, default=7000)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--only", nargs="*", default=[])
    arguments = parser.parse_args()
    kinds = arguments.only or list(FAULTS)
    wanted = [(number, "") for number in range(arguments.clean)]
    wanted += [(10_000 + number, kind) for kind in kinds for number in range(arguments.planted)]
    with ProcessPoolExecutor(arguments.jobs) as pool:
        results = list(pool.map(partial(found_in, arguments.seed), wanted, chunksize=8))
    table: dict[str, Counter[str]] = defaultdict(Counter)
    total: Counter[str] = Counter()
    reasons: dict[str, Counter[str]] = defaultdict(Counter)
    for kind, found, why in results:
        total[kind] += 1
        table[kind].update(found)
        if kind and kind not in found:
            reasons[kind][why[:70] or "not found"] += 1
    print(f"{'kind':18} recall  precision  others found with it; why it was missed")
    for kind in kinds:
        hits = table[kind][kind]
        false = sum(table[other][kind] for other in table if other != kind)
        others = {name: count for name, count in table[kind].items() if name != kind}
        precision = hits / (hits + false) if hits + false else float("nan")
        print(f"{kind:18} {hits / total[kind]:6.3f}  {precision:9.3f}  {others or ''} {dict(reasons[kind]) or ''}")
    real = {name: count for name, count in table[""].items() if name not in FOLLOWS}
    print(f"{total['']} clean episodes: {sum(real.values())} findings {real or ''}", {n: table[""][n] for n in FOLLOWS})


if __name__ == "__main__":
    main()
