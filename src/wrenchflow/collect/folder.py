"""A folder of demonstrations: each recorded to a file of its own, by the clock or as fast as it goes."""

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

from wrenchflow.collect import resume as resuming
from wrenchflow.collect.board.board import Board, Nowhere
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.demonstration import Demonstration, demonstration_in, demonstration_of, id_of
from wrenchflow.collect.devices.device import TeleopDevice
from wrenchflow.collect.operators_table import require_operator
from wrenchflow.collect.session import demonstrate, known_of
from wrenchflow.collect.sim_camera import views_of, without_what_cannot_be_drawn
from wrenchflow.collect.sitting import Sitting
from wrenchflow.control.emergency_stop import EmergencyStop
from wrenchflow.episodes_map import map_episodes
from wrenchflow.errors import ConfigError, OutputError
from wrenchflow.manifest import KEEP, output_folder, write_manifest
from wrenchflow.recording.black_box import BlackBox, black_boxes
from wrenchflow.recording.write import write_episode
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
        config, name = self.config, id_of(self.config, index)
        with BlackBox(self.boxes, ROWS, id=name, task=config.task, meta=known_of(config, index)) as box:
            episode = demonstrate(index, config, box=box)
            write_episode(self.folder / f"{name}.mcap", episode, config.compression)
        return demonstration_of(episode)


def collect_folder(
    out: Path,
    config: CollectConfig,
    *,
    jobs: int = 1,
    overwrite: bool = False,
    resume: bool = False,
    executor: Executor | None = None,
    board: Board | None = None,
    review: bool = False,
    viewer: bool = False,
    device: TeleopDevice | None = None,
) -> Iterator[Demonstration]:
    """Record `config.episodes` demonstrations into a folder, and yield what became of each.

    Args:
        out: Folder of `<id>.mcap` and `manifest.json`; it appears when all are there.
        config: What is demonstrated, by whom.
        jobs: Worker processes.
        overwrite: Replace a folder that is there.
        resume: Go on with a folder that is there, finished or not; those of it that are there are yielded first.
        executor: Used in place of worker processes of its own.
        board: Where it is shown how far all is, while somebody demonstrates by the clock.
        review: Ask that person what shall become of each attempt.
        viewer: Show that person the scene.
        device: What that person holds, in place of what `config` names.

    Raises:
        OutputError: If `out` is there, and may be neither replaced nor gone on with.
        ConfigError: For a task, operator or rig that does not exist, control limits beyond the hardware's, or what
            does not go together.
        StartupError: If the cell is not fit to be started.
        DeviceError: If a device is not there, or was lost.
    """
    _, rig, _ = scenery(config.task, config.rig, config.calibration)
    config = without_what_cannot_be_drawn(config)
    views_of(config, rig)
    require_operator(config)
    if review and not config.is_paced:
        raise ConfigError(
            f"--review asks whoever demonstrates, and '{config.operator}' is a program that runs as fast as it can: "
            "leave it out, or pass --realtime."
        )
    if resume and overwrite:
        raise OutputError("--resume goes on with what is there and --overwrite replaces it: pass one of them.")
    if resume:
        resuming.require_same(out, config)
    # A device that is not there is told of before there is any folder.
    sitting = Sitting(config, board or Nowhere(), review=review, viewer=viewer, device=device)
    with (
        sitting if config.is_paced else nullcontext(),
        output_folder(out, overwrite=overwrite, resume=resume) as folder,
    ):
        if resume:
            resuming.set_cut_off_aside(folder, config)
        there, missing = resuming.there_and_missing(folder, config)
        startup = None
        if not config.is_paced:
            startup = check_cell(config)
            resuming.begin(folder, config, by_the_clock=False)
        yield from map(demonstration_in, there)
        if config.is_paced:
            (folder / KEEP).touch()  # What is recorded by the clock is not done away with by the next run.
            with EmergencyStop() as stop:
                try:
                    startup = check_cell(config, stop)
                finally:  # Somebody who stops the check is told of the stop, not of what the check missed by it.
                    stop.require_none("Nothing was recorded.")
                resuming.begin(folder, config, by_the_clock=True)
                # One after the other: what runs by the clock shares a core with nothing.
                yield from sitting.run(missing, folder, stop, len(there))
        else:
            with black_boxes(out) as boxes:
                yield from map_episodes(_Record(folder, boxes, config), missing, jobs=jobs, executor=executor)
        whole = replace(config, episodes=_count(folder, config)) if sitting.is_last else config
        write_manifest(folder, "collect", whole, seed=config.seed, startup=startup)
        resuming.end(folder)


def _count(folder: Path, config: CollectConfig) -> int:
    """How many there are where somebody wanted no more.

    Raises:
        OutputError: If there is none.
    """
    there, _ = resuming.there_and_missing(folder, config)
    if not there:
        raise OutputError(f"no episode was kept: '{folder}' holds what was discarded, if anything.")
    return len(there)
