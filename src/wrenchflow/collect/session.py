"""Record demonstrations: an operator sees and feels, a device moves the target, the arm follows, and all is kept."""

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from wrenchflow import signals
from wrenchflow.collect.blind_spiral import BlindSpiral
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.devices.emulated_spacemouse import EmulatedSpaceMouse
from wrenchflow.collect.operators import Operator, Perception
from wrenchflow.collect.scripted import Scripted
from wrenchflow.collect.sim_camera import Album, views_of, without_what_cannot_be_drawn
from wrenchflow.config import to_mapping
from wrenchflow.control.controller import TICK_S
from wrenchflow.control.emergency_stop import EmergencyStop
from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.episodes_map import map_episodes
from wrenchflow.errors import ConfigError, unknown
from wrenchflow.filtering import window_mean
from wrenchflow.manifest import KEEP, output_folder, write_manifest
from wrenchflow.observation import MEAN_NS
from wrenchflow.process.live import LiveWrench
from wrenchflow.recording.black_box import BlackBox, black_boxes
from wrenchflow.recording.write import write_episode
from wrenchflow.sim.attempt import DEMONSTRATE, Attempt, Outcome, episode_id
from wrenchflow.sim.startup import check_cell
from wrenchflow.sim.streams import ROWS, streams_of
from wrenchflow.sim.tasks import make_task, scenery
from wrenchflow.sim.tasks.task import mjcf_of
from wrenchflow.spatial import exp_so3, make_pose, rotation_of

OPERATORS = ("scripted", "blind-spiral")


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


def make_operator(name: str, config: CollectConfig) -> Operator:
    """The operator of a name, for the task of `config`.

    Raises:
        ConfigError: If there is none, with the nearest name.
    """
    if name == "scripted":
        return Scripted(config.task, make_task(config.task).phases, config.impedance)
    if name == "blind-spiral":
        return BlindSpiral(config.impedance, period_s=1.0 / config.device_hz)
    raise ConfigError(unknown("operator", name, OPERATORS))


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
    operator = make_operator(config.operator, config)
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
    session = Session(attempt, operator, config)
    known = {"cameras": {view.name: to_mapping(view) for view in views}} if views else {}

    def so_far() -> Episode:
        name = episode_id(config.task, config.seed, index)
        return attempt.episode(name, session.streams(), session.phases(), **_known(config), **known)

    if box is not None:
        box.tell = so_far
    while not attempt.over:
        session.period()
    return replace(so_far(), messages=album.draw(mjcf_of(task, rig) if views else ""))


def _known(config: CollectConfig) -> dict[str, Any]:
    """What is known of an attempt by who runs it, before it begins."""
    return {"operator": config.operator, "collect": to_mapping(config)}


class Session:
    """One attempt with an operator at the device: what they feel, what the device reports, where the target goes."""

    def __init__(self, attempt: Attempt, operator: Operator, config: CollectConfig) -> None:
        self._attempt, self._operator, self._config = attempt, operator, config
        self._feel = LiveWrench(streams_of(attempt.plant.recorded), attempt.tare, attempt.rig)
        self._period_s = 1.0 / config.device_hz
        self._ticks = round(self._period_s / TICK_S)
        self._device = EmulatedSpaceMouse(config.twist_map, self._period_s)
        self._disturbance_m = np.zeros(3)
        self._t: list[int] = []
        self._joy: list[np.ndarray] = []
        self._twist: list[np.ndarray] = []
        self._phases: list[tuple[int, str]] = []

    def period(self) -> None:
        """One report of the device: see, feel, decide, deflect, integrate the target, let the arm follow."""
        attempt, row = self._attempt, self._attempt.plant.recorded[-1]
        now_ns = int(row["t_ns"]) + round(TICK_S * 1e9)
        wanted, phase = self._operator.want(self._perceive(row))
        self._device.deflect(wanted, attempt.target_pose)
        counts, buttons = self._device.read()
        twist = self._config.twist_map.twist(counts)
        self._t.append(now_ns)
        self._joy.append(np.concatenate([counts, buttons]).astype(np.float64))
        self._twist.append(twist)
        if not self._phases or self._phases[-1][1] != phase:
            self._phases.append((now_ns, phase))
        first = attempt.plant.count
        attempt.advance(moved(attempt.target_pose, twist, self._period_s), self._ticks, self._disturb(), self._period_s)
        self._feel.push(*attempt.samples_since(first))

    def _perceive(self, row: np.void) -> Perception:
        felt = self._feel.tail
        return Perception(
            t_s=self._attempt.elapsed_s,
            tcp_pose=row["tcp_pose"],
            goal_pose=self._attempt.scene.T_base_goal_perceived,
            wrench=felt.data[-1],
            wrench_mean=window_mean(felt.t, felt.data, felt.t[-1:], MEAN_NS)[0],
        )

    def _disturb(self) -> np.ndarray:
        # An Ornstein-Uhlenbeck process: the demonstrations then show how to come back from where no operator would go.
        keep = np.exp(-self._period_s / self._config.disturbance_s)
        fresh = self._attempt.rng.normal(size=3) * self._config.disturbance_m * np.sqrt(1.0 - keep**2)
        self._disturbance_m = keep * self._disturbance_m + fresh
        return self._disturbance_m

    @property
    def report(self) -> tuple[int, np.ndarray, np.ndarray]:
        """The device's last report: its stamp [ns], axes and buttons, and the twist that they stand for."""
        return self._t[-1], self._joy[-1], self._twist[-1]

    def streams(self) -> dict[str, Stream]:
        """What the device reported."""
        t = np.array(self._t, np.int64)
        return {
            "teleop/joy": Stream(t, np.array(self._joy).reshape(-1, signals.JOY.width), signals.JOY, "device"),
            "teleop/twist": Stream(t, np.array(self._twist).reshape(-1, signals.TWIST.width), signals.TWIST, "base"),
        }

    def phases(self) -> list[Event]:
        """What the operator thought to be doing, and when."""
        end_ns = int(self._attempt.plant.recorded[-1]["t_ns"])
        edges = pairwise([*self._phases, (end_ns, "")])
        return [Event(start_ns, stop_ns, "phase", name) for (start_ns, name), (stop_ns, _) in edges]


def moved(target: np.ndarray, twist: np.ndarray, duration_s: float) -> np.ndarray:
    """A target pose moved by a twist in the base frame; a device integrates the target, never the measured pose."""
    rotation = exp_so3(twist[3:] * duration_s) @ rotation_of(target[3:])
    return make_pose(target[:3] + twist[:3] * duration_s, rotation)


@dataclass(frozen=True)
class _Record:
    """One episode to a file; an object, so that it travels to a worker process."""

    folder: Path
    boxes: Path
    config: CollectConfig

    def __call__(self, index: int) -> Demonstration:
        config, name = self.config, episode_id(self.config.task, self.config.seed, index)
        with BlackBox(self.boxes, ROWS, id=name, task=config.task, meta=_known(config)) as box:
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
    make_operator(config.operator, config)
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
