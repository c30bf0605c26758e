"""The stage `deploy`: a run folder's policy on a task, many times, recorded and judged."""

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path

from wrenchflow.calibration import calibration_meta
from wrenchflow.config import to_mapping
from wrenchflow.deploy.config import DeployConfig
from wrenchflow.deploy.evaluation import Verdict, judge, summarise
from wrenchflow.episodes_map import map_episodes
from wrenchflow.errors import ConfigError
from wrenchflow.manifest import output_folder, write_json, write_manifest
from wrenchflow.recording.black_box import BlackBox, black_boxes
from wrenchflow.recording.write import write_episode
from wrenchflow.sim.startup import check_cell
from wrenchflow.sim.streams import ROWS
from wrenchflow.sim.tasks import scenery

EVALUATION = "evaluation.json"


@dataclass(frozen=True)
class _Batch:
    """Some attempts of a policy; an object, so that it travels to a worker process."""

    run: Path
    config: DeployConfig
    folder: Path | None
    boxes: Path | None

    def __call__(self, indices: Sequence[int]) -> list[Verdict]:
        import torch

        from wrenchflow.deploy.rollout import roll_out, rollout_id
        from wrenchflow.policy.checkpoint import load_policy
        from wrenchflow.policy.policy import WithoutForceInput

        torch.set_num_threads(1)
        policy = load_policy(self.run)
        acting = WithoutForceInput(policy) if self.config.wrench_input == "zeroed" else policy
        task, rig, model = scenery(self.config.task, self.config.rig, self.config.calibration)
        verdicts, known = [], {"deploy": to_mapping(self.config), **calibration_meta(self.config.calibration)}
        with ExitStack() as stack:
            boxes = [
                stack.enter_context(BlackBox(self.boxes, ROWS, id=name, task=task.name, meta=known))
                for name in (rollout_id(self.config, index) for index in indices)
                if self.boxes is not None
            ]
            for episode in roll_out(indices, acting, task, model, rig, self.config, boxes):
                verdict = judge(episode, self.config)
                verdicts.append(verdict)
                if self.folder is not None:
                    # Who pressed too hard did not succeed, whatever the task says.
                    result = {**episode.meta["result"], **to_mapping(verdict)}
                    write_episode(self.folder / f"{episode.id}.mcap", episode.with_meta(result=result))
        return verdicts


def evaluate(
    run: Path,
    config: DeployConfig,
    *,
    jobs: int = 1,
    folder: Path | None = None,
    boxes: Path | None = None,
    executor: Executor | None = None,
) -> Iterator[Verdict]:
    """Let a policy try `config.episodes` times.

    Args:
        run: The run folder.
        config: Task, seed, limits.
        jobs: Worker processes.
        folder: Where each attempt is recorded; None records nothing.
        boxes: Where the black boxes of attempts go that do not end well; None keeps none.
        executor: Used in place of worker processes of its own.

    Yields:
        One verdict an attempt, in order.

    Raises:
        ConfigError: For an unknown task or rig, or a latency that no plan arrives within an attempt after.
    """
    task, _, _ = scenery(config.task, config.rig, config.calibration)
    if not config.latency_s < task.time_limit_s:
        raise ConfigError(
            f"latency_s is {config.latency_s:g}, expected less than the {task.time_limit_s:g} s "
            f"that an attempt at {task.name} may last."
        )
    batches = [
        range(start, min(start + config.batch, config.episodes)) for start in range(0, config.episodes, config.batch)
    ]
    for verdicts in map_episodes(_Batch(run, config, folder, boxes), batches, jobs=jobs, executor=executor):
        yield from verdicts


def deploy_folder(
    run: Path,
    out: Path,
    config: DeployConfig,
    *,
    jobs: int = 1,
    overwrite: bool = False,
    executor: Executor | None = None,
) -> Iterator[Verdict]:
    """Deploy a run's policy, and write `<id>.mcap`, `evaluation.json` and `manifest.json`.

    Args:
        run: The run folder.
        out: Folder of the recordings; it appears when all are there.
        config: Task, seed, limits.
        jobs: Worker processes.
        overwrite: Replace a folder that is there.
        executor: Used in place of worker processes of its own.

    Yields:
        One verdict an attempt, in order.

    Raises:
        CheckpointError: If `run` holds no policy that fits.
        OutputError: If `out` is there, and may not be replaced.
        ConfigError: For control limits beyond the hardware's.
        StartupError: If the cell is not fit to be started.
    """
    from wrenchflow.policy.checkpoint import load_policy

    load_policy(run)  # A run that cannot be loaded is refused here, before workers start.
    with output_folder(out, overwrite=overwrite, reads=[run]) as folder:
        startup = check_cell(config)
        verdicts = []
        with black_boxes(out) as boxes:
            for verdict in evaluate(run, config, jobs=jobs, folder=folder, boxes=boxes, executor=executor):
                verdicts.append(verdict)
                yield verdict
        attempts = [asdict(verdict) for verdict in verdicts]
        write_json(folder / EVALUATION, {**summarise(verdicts), "attempts_by_id": attempts})
        write_manifest(folder, "deploy", config, sorted(run.glob("*.json")), seed=config.seed, startup=startup)
