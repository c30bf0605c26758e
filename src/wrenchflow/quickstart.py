"""Everything once: demonstrate, process, export, train, deploy, compare, and a page that shows what came out.

It stands above the rooms, beside the command line, and is imported by nothing but it.
"""

import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Protocol, TypedDict, runtime_checkable

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.folder import collect_folder
from wrenchflow.collect.session import demonstrate
from wrenchflow.datasets.config import ExportConfig
from wrenchflow.datasets.export import export_folder
from wrenchflow.deploy.config import DeployConfig
from wrenchflow.deploy.evaluation import Verdict, judge, paired_p_value, summarise
from wrenchflow.deploy.run import deploy_folder, evaluate
from wrenchflow.episodes_map import map_episodes, worker_pool
from wrenchflow.errors import OutputError
from wrenchflow.manifest import NAME, read_manifest, versions
from wrenchflow.present import write_evaluation_page, write_quickstart_page
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.pipeline import process_folder
from wrenchflow.quickstart_config import TASK, QuickstartConfig
from wrenchflow.recording.reader import find_recordings, read_episode
from wrenchflow.sim.attempt import EVALUATE
from wrenchflow.train.config import TrainConfig
from wrenchflow.train.loop import Metrics
from wrenchflow.train.run import train_folder

_OUTPUTS = ("raw", "clean", "dataset", "run", "run_without_force", "rollouts", "index.html")


class _Options(TypedDict):
    executor: Executor
    overwrite: bool


@runtime_checkable
class Watch(Protocol):
    """How whoever calls wants to see a stage: takes its results as they come, and gives all of them."""

    def __call__[T](self, stage: str, results: Iterator[T], total: int) -> list[T]:
        """Exhaust `results`, of which there will be `total`."""
        ...


def run_quickstart(out: Path, config: QuickstartConfig, watch: Watch, *, jobs: int, overwrite: bool) -> dict[str, Any]:
    """Run the whole chain into `out`.

    Args:
        out: Gets `raw clean dataset run run_without_force rollouts index.html`.
        config: How much of everything.
        watch: Shows progress.
        jobs: Worker processes.
        overwrite: Replace what is there.

    Returns:
        The figures that `--json` prints.

    Raises:
        OutputError: If `out` holds any of its outputs already and may not replace them, or is another stage's.
    """
    if (out / NAME).exists():
        stage = read_manifest(out)["stage"]
        raise OutputError(f"output '{out}' is a folder that '{stage}' wrote. Choose another place.")
    there = [name for name in _OUTPUTS if (out / name).exists()]
    if there and not overwrite:
        raise OutputError(
            f"output '{out}' holds {', '.join(there)} already. Choose another place, or pass --overwrite."
        )
    _clear(out, there)
    with worker_pool(jobs) as pool:  # One for all: a worker spends seconds on loading torch and MuJoCo.
        chain = _Chain(out, config, watch, pool, overwrite)
        demonstrations = chain.demonstrations()
        training = chain.train()
        arms = chain.arms()
    result = summarise(arms["policy"])
    shown = summarise(arms["demonstrations"])
    kept = ("successes", "success_rate", "success_interval", "peak_force_n", "duration_s", "failures")
    summary = {
        "task": TASK,
        "seed": config.seed,
        **demonstrations,
        "demonstrations": {key: shown[key] for key in ("success_rate", "peak_force_n", "duration_s")},
        "rollouts": result["attempts"],
        **{key: result[key] for key in kept},
        "force_limit_n": chain.deploy.force_limit_n,
    }
    for name in ("zeroed_force", "without_force", "blind_spiral"):
        other = summarise(arms[name])
        summary |= {f"{name}_{key}": other[key] for key in ("success_rate", "success_interval", "peak_force_n")}
        summary[f"{name}_p_value"] = paired_p_value(arms["policy"], arms[name])
    summary["seconds"] = chain.seconds
    peaks_n = [verdict.peak_force_n for verdict in arms["policy"]]
    page = {**summary, "training": training, "peak_forces_n": peaks_n, "versions": versions()}
    chain.timed("page", lambda: _write_pages(out, page, arms["policy"]))
    return summary


def _clear(out: Path, names: Sequence[str]) -> None:
    """Remove an earlier run, its page first: what is half of one run and half of another must not look whole.

    Raises:
        OutputError: If one of them is nothing that wrenchflow made; nothing is removed then.
    """
    for name in names:
        path = out / name
        if path.is_dir() and not _is_ours(path):
            raise OutputError(f"output '{path}' is no folder that wrenchflow made. Choose another place.")
    for name in reversed(names):
        path = out / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink()


def _is_ours(folder: Path) -> bool:
    """Whether a stage finished it, or it holds nothing but data sets, whole or half: `export` marks only whole ones."""
    return (folder / NAME).exists() or all(
        entry.name.startswith(("robomimic.", "lerobot")) for entry in folder.iterdir()
    )


class _Chain:
    """The stages, one after the other, each timed."""

    def __init__(self, out: Path, config: QuickstartConfig, watch: Watch, pool: Executor, overwrite: bool) -> None:
        self.out, self.watch = out, watch
        self.options: _Options = {"executor": pool, "overwrite": overwrite}
        self.collect = CollectConfig(task=TASK, episodes=config.episodes, seed=config.seed)
        self.train_config = TrainConfig(steps=config.train_steps, seed=config.seed, threads=1)
        self.deploy = DeployConfig(task=TASK, episodes=config.rollouts, seed=config.seed)
        self.seconds: dict[str, float] = {}

    def timed[T](self, stage: str, work: Callable[[], T]) -> T:
        """Do a piece of work and add its time to a stage's."""
        start = time.perf_counter()
        result = work()
        self.seconds[stage] = round(self.seconds.get(stage, 0.0) + time.perf_counter() - start, 1)
        return result

    def run[T](self, stage: str, results: Iterator[T], total: int, label: str = "") -> list[T]:
        """Watch a stage to its end."""
        return self.timed(stage, lambda: self.watch(label or stage, results, total))

    def demonstrations(self) -> dict[str, int]:
        """Collect, process, export."""
        raw, clean, dataset, n = self.out / "raw", self.out / "clean", self.out / "dataset", self.collect.episodes
        done = self.run("collect", collect_folder(raw, self.collect, **self.options), n)
        self.run("process", process_folder(raw, clean, ProcessConfig(), **self.options), n)
        exporting = export_folder("robomimic,lerobot", clean, dataset, ExportConfig(), **self.options)
        steps = sum(episode.steps for episode in self.run("export", exporting, n))
        return {"episodes": len(done), "samples": sum(demonstration.samples for demonstration in done), "steps": steps}

    def train(self) -> dict[str, list[Any]]:
        """Train the policy and, beside it, the same one without force; returns the first one's curve."""
        # One thread each: two processes share two cores better than two threads of one, which wait for each other.
        felt, blunt = self.train_config, replace(self.train_config, features="without_force")
        dataset = self.out / "dataset" / "robomimic.hdf5"
        both = [_Training(dataset, self.out / "run", felt), _Training(dataset, self.out / "run_without_force", blunt)]
        work = partial(_train, overwrite=self.options["overwrite"])
        metrics = self.run("train", map_episodes(work, both, executor=self.options["executor"]), len(both))[0]
        return {
            "steps": [row.step for row in metrics],
            "loss": [row.loss for row in metrics],
            "validation_loss": [row.valid_loss for row in metrics],
        }

    def arms(self) -> dict[str, list[Verdict]]:
        """Let the policy, the same without its sense of force, the one without force and the baseline try.

        The demonstrations are judged beside them, by the same measure: the largest force that `process` finds has been
        through another filter.
        """
        out, config, n, pool = self.out, self.deploy, self.deploy.episodes, self.options["executor"]
        deploying = deploy_folder(out / "run", out / "rollouts", config, **self.options)
        zeroed = evaluate(out / "run", replace(config, wrench_input="zeroed"), executor=pool)
        without = evaluate(out / "run_without_force", config, executor=pool)
        spiral = map_episodes(_Spiral(self.collect, config), range(n), executor=pool)
        raw = find_recordings(out / "raw")
        shown = map_episodes(_Judge(config), raw, executor=pool)
        return {
            "policy": self.run("deploy", deploying, n),
            "zeroed_force": self.run("compare", zeroed, n, "compare: force zeroed"),
            "without_force": self.run("compare", without, n, "compare: without force"),
            "blind_spiral": self.run("compare", spiral, n, "compare: blind spiral"),
            "demonstrations": self.run("compare", shown, len(raw), "compare: demonstrations"),
        }


@dataclass(frozen=True)
class _Training:
    """One policy to be trained; travels to a worker process."""

    dataset: Path
    out: Path
    config: TrainConfig


def _train(training: _Training, *, overwrite: bool) -> list[Metrics]:
    rows = train_folder(training.dataset, training.out, training.config, overwrite=overwrite)
    return [row.metrics for row in rows]


@dataclass(frozen=True)
class _Judge:
    """Judges a recording as rollouts are judged."""

    limits: DeployConfig

    def __call__(self, path: Path) -> Verdict:
        return judge(read_episode(path), self.limits)


@dataclass(frozen=True)
class _Spiral:
    """The baseline on the scene of one rollout; an object, so that it travels to a worker process."""

    collect: CollectConfig
    deploy: DeployConfig

    def __call__(self, index: int) -> Verdict:
        config = replace(self.collect, operator="blind-spiral", seed=self.deploy.seed, disturbance_m=0.0)
        return judge(demonstrate(index, config, scenes=EVALUATE), self.deploy)


def _write_pages(out: Path, summary: dict[str, Any], verdicts: Sequence[Verdict]) -> None:
    write_evaluation_page(out / "rollouts", summary["task"], verdicts, summary["force_limit_n"])
    write_quickstart_page(out, summary, verdicts)
