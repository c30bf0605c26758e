"""Record demonstrations: an operator sees and feels, a device moves the target, the arm follows, and all is kept."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from wrenchflow import signals
from wrenchflow.calibration import calibration_meta
from wrenchflow.collect.config import PEOPLE, CollectConfig
from wrenchflow.collect.demonstration import id_of
from wrenchflow.collect.devices.device import TeleopDevice
from wrenchflow.collect.devices.emulated_spacemouse import FULL_SCALE_COUNTS
from wrenchflow.collect.follow import PERIOD, Follower, follow, note
from wrenchflow.collect.hand import operate
from wrenchflow.collect.hand_driver import HandDriver
from wrenchflow.collect.hand_loop import decide, drive
from wrenchflow.collect.operators_table import make_driver
from wrenchflow.collect.profiles import person_of
from wrenchflow.collect.sim_camera import Album, views_of
from wrenchflow.collect.tare import tares_of
from wrenchflow.config import to_mapping
from wrenchflow.control.controller import TICK_S
from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.recording.black_box import BlackBox
from wrenchflow.sim.attempt import DEMONSTRATE, Attempt
from wrenchflow.sim.engine import advance
from wrenchflow.sim.tasks import scenery
from wrenchflow.sim.tasks.task import mjcf_of


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
    task, rig, model = scenery(config.task, config.rig, config.calibration)
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
        tares=tares_of(config),
        time_limit_s=config.time_limit_s,
    )
    session = Session(attempt, config)
    known = {"cameras": {view.name: to_mapping(view) for view in views}} if views else {}

    def so_far() -> Episode:
        name = id_of(config, index)
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
    # How many there are is nothing to any of them.
    configured = {name: value for name, value in to_mapping(config).items() if name != "episodes"}
    known = {"operator": config.operator, "collect": configured, **calibration_meta(config.calibration)}
    if config.operator not in (*PEOPLE, "hand-guided"):
        known["device"] = {"name": "emulated-spacemouse", "full_scale_counts": FULL_SCALE_COUNTS}
    if config.operator not in ("emulated", "hand-guided"):
        return known
    name, person = person_of(config, index)
    return {**known, "person": {"profile": name, **to_mapping(person)}}


def kernels_of(config: CollectConfig) -> tuple[Callable[..., Any], ...]:
    """The kernels that Python calls in an attempt: the loop, and who drives."""
    if config.operator == "emulated":
        return (advance, decide if config.is_paced else drive)
    return (advance, follow, operate) if config.operator == "hand-guided" else (advance, follow)


_FLICKER_S = 0.05  # Nobody begins something and goes back to what they did before as fast.
_STRETCH_PERIODS = 32  # What Python does between two stretches then costs a tenth of a microsecond a tick.


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
        starts = _starts_of(done["phase"], round(_FLICKER_S / TICK_S / self._ticks))
        edges = [*(int(done["t_ns"][i]) for i in starts), int(self._attempt.plant.recorded[-1]["t_ns"])]
        labels = [names[done["phase"][i]] for i in starts]
        return [Event(*span, "phase", label) for span, label in zip(pairwise(edges), labels, strict=True)]


def _starts_of(phases: np.ndarray, flicker: int) -> list[int]:
    """Where phases start; one that comes back within so many periods was never left, but for what the sensor's noise
    made of it.
    """
    edges = [0, *(np.flatnonzero(np.diff(phases)) + 1).tolist(), len(phases)]
    starts: list[int] = []
    for start, stop in pairwise(edges):
        if starts and phases[starts[-1]] == phases[start]:
            continue
        is_short = starts and stop - start <= flicker and stop < len(phases)
        if not (is_short and phases[stop] == phases[starts[-1]]):
            starts.append(start)
    return starts
