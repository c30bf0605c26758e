"""Record demonstrations: an operator sees and feels, a device moves the target, the arm follows, and all is kept."""

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from wrenchflow import signals
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.devices.device import TeleopDevice
from wrenchflow.collect.follow import PERIOD, Follower, note
from wrenchflow.collect.hand_driver import HandDriver
from wrenchflow.collect.operators_table import make_driver, require_operator
from wrenchflow.collect.profiles import person_of
from wrenchflow.collect.sim_camera import Album, views_of, without_what_cannot_be_drawn
from wrenchflow.config import to_mapping
from wrenchflow.control.controller import TICK_S
from wrenchflow.control.emergency_stop import EmergencyStop
from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.episodes_map import map_episodes
from wrenchflow.manifest import KEEP, output_folder, write_manifest
from wrenchflow.recording.black_box import BlackBox, black_boxes
from wrenchflow.recording.write import write_episode
from wrenchflow.sim.attempt import DEMONSTRATE, Attempt, Outcome, episode_id
from wrenchflow.sim.startup import check_cell
from wrenchflow.sim.streams import ROWS
from wrenchflow.sim.tasks import scenery
from wrenchflow.sim.tasks.task import mjcf_of


@dataclass(frozen=True, kw_only=True)
class Demonstration:
    """What became of one recorded attempt.

    Attributes:
        id: Of the episode.
        samples: At 1 kHz.
        outcome: Done or not.
        late_ticks: Of those that go by the clock, how many began more than a millisecond late.
        lost: Rows that found no room, and rows and pictures that were never taken.
        problems: What went wrong with cameras.
    """

    id: str
    samples: int
    outcome: Outcome
    late_ticks: int = 0
    lost: int = 0
    problems: tuple[str, ...] = ()


def demonstrate(
    index: int,
    config: CollectConfig,
    *,
    scenes: int = DEMONSTRATE,
    box: BlackBox | None = None,
    without: Sequence[str] = (),
) -> Episode:
    """Record one attempt, in virtual time.

    Args:
        index: Number of the episode; with the seed it determines every bit of the recording.
        config: Task, operator, device and gains.
        scenes: `DEMONSTRATE`, or `EVALUATE` for an operator that is compared with a policy on the policy's scenes.
        box: Where rows are stored, so that something is left if the attempt does not end well.
        without: Safeguards that are left out, to see what each is worth.
    """
    task, rig, model = scenery(config.task, config.rig)
    config = compliant(config)
    views = views_of(config, rig)
    album = Album(views)
    attempt = Attempt(
        task,
        model,
        rig,
        config,
        seed=(config.seed, index, scenes),
        glance=album if views else None,
        glance_hz=config.camera.rate_hz,
        keep=box.rows if box else None,
        without=without,
    )
    session = Session(attempt, config)
    known = {"cameras": {view.name: to_mapping(view) for view in views}} if views else {}

    def so_far() -> Episode:
        name = episode_id(config.task, config.seed, index)
        return attempt.episode(name, session.streams(), session.phases(), **known_of(config, index), **known)

    if box is not None:
        box.tell = so_far
    session.run()
    return replace(so_far(), messages=album.draw(mjcf_of(task, rig) if views else ""))


def compliant(config: CollectConfig) -> CollectConfig:
    """The same with the stiffness of an arm that is led by hand, where it is."""
    return replace(config, impedance=config.guided) if config.operator == "hand-guided" else config


def known_of(config: CollectConfig, index: int) -> dict[str, Any]:
    """What is known of an attempt by who runs it, before it begins."""
    known = {"operator": config.operator, "collect": to_mapping(config)}
    if config.operator not in ("emulated", "hand-guided"):
        return known
    name, person = person_of(config, index)
    return {**known, "person": {"profile": name, **to_mapping(person)}}


_STRETCH_PERIODS = 8  # What Python does between two stretches then costs less than a microsecond a tick.


class Session:
    """One attempt with somebody who drives: what the device reports, where the target goes, and what is kept of it."""

    def __init__(self, attempt: Attempt, config: CollectConfig, device: TeleopDevice | None = None) -> None:
        """Begin after the tare.

        Args:
            attempt: Tared.
            config: Who drives, by what map, how often.
            device: What a person drives with; without it the operator of `config` does.

        Raises:
            ConfigError: If there is no such operator.
            CalibrationError: If the arm did not rest during the tare, or something touched it.
        """
        self._attempt = attempt
        self._ticks = round(1.0 / config.device_hz / TICK_S)
        self._periods = np.zeros(-(-(len(attempt.plant.rows) - attempt.plant.count) // self._ticks), PERIOD)
        self._count = 0
        self._driver = make_driver(attempt, config, self._periods, device)
        self._follower = Follower(
            config.twist_map,
            attempt.impedance,
            attempt.controller.target_pose,
            full_scale_counts=self._driver.full_scale_counts,
            ticks=self._ticks,
        )

    def run(self) -> None:
        """Go on to the end, as fast as possible, to the bit as a period at a time."""
        if not isinstance(self._driver, HandDriver) or not self._attempt.is_free:
            while not self._attempt.over:
                self.period()
            return
        drive = self._driver.driving(self._follower)
        while not self._attempt.over:
            self._count += self._attempt.stretch(self._ticks, _STRETCH_PERIODS, drive)

    def period(self) -> None:
        """One report of the device: read it, move the target by it, let the arm follow."""
        attempt = self._attempt
        first = attempt.plant.count
        phase = self._driver.decide(attempt, self._follower, attempt.now_ns)
        note(self._follower.record[0], phase, self._periods[self._count])
        self._count += 1
        attempt.follow(self._ticks)
        self._driver.look_back(attempt, first)

    @property
    def problem(self) -> str:
        """Why the arm does not follow the device now; empty if it does."""
        return self._follower.problem

    @property
    def report(self) -> np.void:
        """The last period, a `PERIOD` record."""
        return self._periods[self._count - 1]

    def streams(self) -> dict[str, Stream]:
        """What the device reported."""
        done = self._periods[: self._count]
        joy, twist = done["teleop/joy"].copy(), done["teleop/twist"].copy()
        return {
            "teleop/joy": Stream(done["t_ns"].copy(), joy, signals.JOY, "device"),
            "teleop/twist": Stream(done["t_ns"].copy(), twist, signals.TWIST, "base"),
        }

    def phases(self) -> list[Event]:
        """What the operator thought to be doing, and when; nothing of people, who do not say."""
        done, names = self._periods[: self._count], self._attempt.task.phases
        if not len(done) or done["phase"][0] < 0:
            return []
        starts = [0, *(np.flatnonzero(np.diff(done["phase"])) + 1)]
        edges = [*(int(done["t_ns"][i]) for i in starts), int(self._attempt.plant.recorded[-1]["t_ns"])]
        labels = [names[done["phase"][i]] for i in starts]
        return [Event(*span, "phase", label) for span, label in zip(pairwise(edges), labels, strict=True)]


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
