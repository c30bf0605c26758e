"""A folder of demonstrations: each recorded to a file of its own, by the clock or as fast as it goes."""

from collections.abc import Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.demonstration import Demonstration
from wrenchflow.collect.operators_table import require_operator
from wrenchflow.collect.session import demonstrate, known_of
from wrenchflow.collect.sim_camera import views_of, without_what_cannot_be_drawn
from wrenchflow.control.emergency_stop import EmergencyStop
from wrenchflow.episodes_map import map_episodes
from wrenchflow.manifest import KEEP, output_folder, write_manifest
from wrenchflow.recording.black_box import BlackBox, black_boxes
from wrenchflow.recording.write import write_episode
from wrenchflow.sim.attempt import Outcome, episode_id
from wrenchflow.sim.startup import check_cell
from wrenchflow.sim.streams import ROWS
from wrenchflow.sim.tasks import scenery


@dataclass(frozen=True)
class _Record:
    """One episode to a file; an object, so that it travels to a worker process."""

    folder: Path
    boxes: Path
    config: CollectConfig

    def __call__(self, index: int) -> Demonstration:
        config, name = self.config, episode_id(self.config.task, self.config.seed, index)
        with BlackBox(self.boxes, ROWS, id=name, task=config.task, meta=known_of(config, index)) as box:
            episode = demonstrate(index, config, box=box)
            write_episode(self.folder / f"{name}.mcap", episode, config.compression)
        outcome = Outcome(**episode.meta["result"])
        return Demonstration(id=name, samples=len(episode["tcp_pose"]), outcome=outcome)


def collect_folder(
    out: Path, config: CollectConfig, *, jobs: int = 1, overwrite: bool = False, executor: Executor | None = None
) -> Iterator[Demonstration]:
    """Record `config.episodes` demonstrations into a folder, and yield what became of each.

    Args:
        out: Folder of `<id>.mcap` and `manifest.json`; it appears when all are there.
        config: What is demonstrated, by whom.
        jobs: Worker processes.
        overwrite: Replace a folder that is there.
        executor: Used in place of worker processes of its own.

    Raises:
        OutputError: If `out` is there, and may not be replaced.
        ConfigError: For a task, operator or rig that does not exist, or control limits beyond the hardware's.
        StartupError: If the cell is not fit to be started.
    """
    _, rig, _ = scenery(config.task, config.rig)
    config = without_what_cannot_be_drawn(config)
    views_of(config, rig)
    require_operator(config)
    with output_folder(out, overwrite=overwrite) as folder:
        startup = None if config.realtime or config.live else check_cell(config)
        if config.realtime or config.live:
            from wrenchflow.collect.realtime import demonstrate_in_real_time

            (folder / KEEP).touch()  # What is recorded by the clock is not done away with by the next run.
            with EmergencyStop() as stop:
                try:
                    startup = check_cell(config, stop)
                finally:  # Somebody who stops the check is told of the stop, not of what the check missed by it.
                    stop.require_none("Nothing was recorded.")
                # One after the other: what runs by the clock shares a core with nothing.
                for index in range(config.episodes):
                    yield demonstrate_in_real_time(index, config, folder, stop)
                    stop.require_none(f"{index + 1} of {config.episodes} episodes are in '{folder}'.")
        else:
            with black_boxes(out) as boxes:
                record = _Record(folder, boxes, config)
                yield from map_episodes(record, range(config.episodes), jobs=jobs, executor=executor)
        write_manifest(folder, "collect", config, seed=config.seed, startup=startup)
