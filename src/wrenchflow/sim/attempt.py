"""One attempt at a task in virtual time: the scene, the plant, the controller, the tare at rest, the outcome."""

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from wrenchflow.config import to_mapping
from wrenchflow.control.controller import TICK_NS, TICK_S, Controller
from wrenchflow.control.safeguards import MODES, SAFEGUARDS
from wrenchflow.episode import Episode, Event, Stream
from wrenchflow.errors import CalibrationError
from wrenchflow.ledger import STREAM, Ledger
from wrenchflow.messages import Attachment
from wrenchflow.rig import Rig
from wrenchflow.signals import GOVERNOR, POSE
from wrenchflow.sim.config import AttemptConfig
from wrenchflow.sim.plant import Drive, Measurement, Plant
from wrenchflow.sim.state import looks_of, model_bytes, state_of
from wrenchflow.sim.streams import streams_of
from wrenchflow.sim.tasks.task import Scene, Task, mjcf_of

Beat = Callable[[np.ndarray], None]
# Called with the time [ns], the number of a picture, and what the scene looks like then.
Glance = Callable[[int, int, np.ndarray], None]
# Called with what is known of an attempt and how many rows there may be; gives zeros of dtype `ROW` to store them in.
Keep = Callable[[Mapping[str, Any], int], np.ndarray]

_MARGIN_S = 1.0  # The last step may end after the time limit.
_REST_S = 0.5  # So long an arm that is latched is still recorded.
# Names of attached files: the model for people and pictures, and the same to the last bit.
MJCF, MODEL = "model.xml", "model.mjb.gz"
# Last number of a seed: evaluation never meets a scene that was demonstrated, nor either the start's check, and who is
# demonstrating is drawn apart, as is a sensor that is calibrated.
DEMONSTRATE, EVALUATE, CHECK, PERSON, CALIBRATE = range(5)


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How an attempt ended: done or not, after how long, and if not, why."""

    success: bool
    duration_s: float
    progress: float
    failure: str


@dataclass(frozen=True, kw_only=True)
class Tares:
    """How often the sensor may be tared before an attempt is given up.

    Attributes:
        judge: Says, after each, why it cannot be used; nothing where it can.
        most: How many there are at most.
        wait_s: Between one that was refused and the next [s].
    """

    judge: "Callable[[Attempt], str]"
    most: int = 1
    wait_s: float = 0.0


class Attempt:
    """A task drawn from a seed, with the arm at rest at its start; whoever acts on it asks its controller."""

    def __init__(
        self,
        task: Task,
        model: mujoco.MjModel,
        rig: Rig,
        config: AttemptConfig,
        *,
        seed: tuple[int, ...],
        measurement: Measurement | None = None,
        beat: "Callable[[Attempt], Beat] | None" = None,
        glance: Glance | None = None,
        glance_hz: float = 30.0,
        without: Iterable[str] = (),
        keep: Keep | None = None,
        tares: Tares | None = None,
        time_limit_s: float | None = None,
    ) -> None:
        """Draw the scene, then let the arm hold its start for the tare, whose second half tells the sensor's bias.

        Args:
            task: What is attempted.
            model: of the task with the arm of `rig`; may be shared.
            rig: The robot cell.
            config: Tare, impedance, limits and gains of the core.
            seed: Every random number comes from these.
            measurement: How well the arm knows itself.
            beat: Makes, once the scene is drawn, what is called after every tick with its row; then ticks go one by
                one, and may be paced by a clock. Without it they run as fast as they can.
            glance: Called `glance_hz` times a second; what happens does not depend on it.
            glance_hz: Pictures a second.
            without: Safeguards that are left out, to see what each is worth.
            keep: Gives the memory that rows are stored in, such as a black box's; without it they are nobody else's.
            tares: Who judges the tare, and how often it may be done again; without it any will do.
            time_limit_s: How long it may last [s]; without it, as long as the task says.

        Raises:
            CalibrationError: If the last tare that there may be was refused; the message says why.
        """
        scene_rng, plant_rng, self.rng, self.link_rng = generators(seed)
        self.task, self.rig, self.seed, self.impedance = task, rig, seed, config.impedance
        self.scene: Scene = task.draw(model, scene_rng)
        data = mujoco.MjData(model)
        task.place(model, data, self.scene)
        self.time_limit_s = task.time_limit_s * config.patience if time_limit_s is None else time_limit_s
        again_s = 0.0 if tares is None else (tares.most - 1) * (config.tare_s + tares.wait_s + TICK_S)
        capacity_s = config.tare_s + again_s + self.time_limit_s + _MARGIN_S
        self.plant = Plant(model, data, rig, measurement or Measurement(), plant_rng, capacity_s=capacity_s)
        self._without = tuple(without)
        self.controller = Controller(rig, config.control, without=self._without)
        self.controller.set_contact_zone(*task.contact_zone(self.scene))
        self.plant.begin(self.controller, config.impedance)
        self._start_state = state_of(model, data)
        self._refusals: list[tuple[int, str]] = []
        self._refused_tares: list[Event] = []
        self._ended = ""
        if keep is not None:
            self.plant.rows = keep(self.meta, len(self.plant.rows))
        self._glance, self._glance_hz, self._glances = glance, glance_hz, 0
        self.beat = None if beat is None else beat(self)
        self._referee, self._watched = task.referee(self.scene), 0
        self.tare = self._tare(config.tare_s, tares)
        self.start_ns = self.tare.stop_ns

    def _tare(self, tare_s: float, tares: Tares | None) -> Event:
        """Rest, again and again until the rest will do; the safety layer, which has a bias of its own, begins anew."""
        while True:
            # The force of a tick comes with the next row, so the last row's is still to come: the tare ends before it,
            # and who tares now has the very samples that who reads the recording has.
            rows = self._run(round(tare_s / TICK_S) + 1)
            half = len(rows) // 2
            self.tare = Event(int(rows["t_ns"][half]), int(rows["t_ns"][-1]), "phase", "tare")
            # Who is stopped has other things to do than to find out about a bias.
            why = "" if tares is None or self._stopped else tares.judge(self)
            if not why or tares is None:
                return self.tare
            self._refused_tares.append(Event(self.tare.start_ns, self.tare.stop_ns, "tare", f"refused: {why}"))
            count = len(self._refused_tares)
            if count >= tares.most:
                times = "once" if count == 1 else f"{count} times, the last time because"
                raise CalibrationError(f"the tare before the attempt was refused {times}: {why}")
            self._run(round(tares.wait_s / TICK_S))
            self.controller.tare_again()

    def end(self, why: str) -> None:
        """Let it be over, for a reason that only who runs it knows; a success stays one."""
        self._ended = self._ended or why

    def accept(self, packet: np.ndarray) -> str:
        """Take in a plan before the next tick: what becomes of it, by `Controller.accept`."""
        reason = self.controller.accept(packet, self.now_ns)
        if reason != "accepted":
            self._refusals.append((self.now_ns, reason))
        return reason

    def follow(self, ticks: int, drive: Drive | None = None) -> np.ndarray:
        """Let the arm follow what it was asked for; returns the new rows.

        Args:
            ticks: How many.
            drive: Runs them in place of `sim.engine.advance`, with the same arguments, and may ask meanwhile; only
                where `is_free`.
        """
        return self._run(ticks, drive)

    def stretch(self, ticks: int, count: int, drive: Drive) -> int:
        """Run up to `count` times `ticks` ticks at once, and end where it is over; returns how many times they ran.

        An attempt that was over in the middle is cut off there: what the arm did afterwards was never.

        Args:
            ticks: Of a period.
            count: Periods, fewer where time runs out, and one only while the arm is stopped.
            drive: As of `follow`.
        """
        left = math.ceil((self.time_limit_s - self.elapsed_s) / (ticks * TICK_S) - 1e-9)
        count = 1 if self.controller.mode == "latched" else max(1, min(count, left))
        first = self.plant.count
        self._run(ticks * count, drive)
        if not self._is_decided:
            return count
        # Another referee sees it all again, the last of it a period at a time.
        self._referee, self._watched, self.plant.count = self.task.referee(self.scene), 0, first
        self._watch()
        for done in range(1, count + 1):
            self.plant.count = first + done * ticks
            self._watch()
            if self._is_decided:
                return done
        return count

    @property
    def is_free(self) -> bool:
        """Whether nothing has to happen between ticks: no beat and no pictures."""
        return self.beat is None and self._glance is None

    @property
    def now_ns(self) -> int:
        """Stamp of the next tick."""
        return int(self.plant.recorded[-1]["t_ns"]) + TICK_NS

    def _run(self, ticks: int, drive: Drive | None = None) -> np.ndarray:
        first = self.plant.count
        stop = first + ticks
        while self.plant.count < stop:
            if self._glance is None:
                self._tick(stop - self.plant.count, drive)
                continue
            due = tick_of_picture(self._glances, self._glance_hz)
            self._tick(min(due, stop) - self.plant.count)
            if self.plant.count == due:
                self._glance(self.now_ns, self._glances, looks_of(self.plant.model, self.plant.data))
                self._glances += 1
        self._watch()
        return self.plant.rows[first:stop]

    def _watch(self) -> None:
        seen = self.plant.seen[self._watched :]
        self._referee.see(seen["tcp_pose"], seen["wrench"])
        self._watched += len(seen)

    def _tick(self, ticks: int, drive: Drive | None = None) -> None:
        if self.beat is None:
            self.plant.advance(self.controller, ticks, drive)
            return
        for _ in range(ticks):
            self.beat(self.plant.advance(self.controller, 1))

    def samples_since(self, first: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Stamps, raw wrenches and TCP quaternions of the wrench samples that rows from `first` on brought.

        A row carries the force of the tick before it, so each belongs to the stamp and the pose of that tick.
        """
        rows = self.plant.rows[first - 1 : self.plant.count]
        return rows["t_ns"][:-1].copy(), rows["wrench_raw"][1:].copy(), rows["tcp_pose"][:-1, 3:].copy()

    @property
    def elapsed_s(self) -> float:
        """Time since the tare [s]."""
        return self.plant.count * TICK_S - (self.start_ns - int(self.plant.rows["t_ns"][0])) * 1e-9

    @property
    def outcome(self) -> Outcome:
        """How things stand now, as the referee sees them."""
        progress = float(self._referee.progress)
        success = progress >= 1.0
        return Outcome(
            success=success,
            duration_s=self.elapsed_s,
            progress=progress,
            failure="" if success else self._stopped or self._ended or self._referee.failure,
        )

    @property
    def _stopped(self) -> str:
        """What the safety layer ended the attempt for, or nothing; nobody resets an arm while an attempt runs."""
        return f"stopped: {self.controller.cause}" if self.controller.mode in ("soft-stop", "latched") else ""

    @property
    def over(self) -> bool:
        """Whether the task is done or lost, somebody ended it, its time is up, or the arm is latched and could rest."""
        if self._ended or self.elapsed_s >= self.time_limit_s or self.controller.latched_s >= _REST_S:
            return True
        return self._is_decided

    @property
    def _is_decided(self) -> bool:
        return self._referee.progress >= 1.0 or self._referee.is_lost

    @property
    def events(self) -> tuple[Event, ...]:
        """The tare and those before it, what the safety layer did, and how things stand now as the end."""
        end_ns, outcome = int(self.plant.recorded["t_ns"][-1]), self.outcome
        end = Event(end_ns, end_ns, "success" if outcome.success else "failure", outcome.failure)
        return *self._refused_tares, self.tare, *self.ledger.events, end

    @property
    def ledger(self) -> Ledger:
        """The safety layer's account so far."""
        rows = self.plant.recorded
        governor = Stream(rows["t_ns"].copy(), rows[STREAM].copy(), GOVERNOR, "base")
        return Ledger(governor=governor, modes=MODES, safeguards=tuple(SAFEGUARDS), refusals=tuple(self._refusals))

    @property
    def safety(self) -> dict[str, Any]:
        """What the safety layer did so far, in figures: the ledger's, and what was refused, by reason."""
        return {**self.ledger.summary(), "refusals": self.controller.refusals}

    @property
    def meta(self) -> dict[str, Any]:
        """What is known of an attempt before it begins."""
        return {
            "rig": to_mapping(self.rig),
            "seed": list(self.seed),
            "impedance": to_mapping(self.impedance),
            **({"without": list(self._without)} if self._without else {}),
            STREAM: {"modes": list(MODES), "safeguards": list(SAFEGUARDS)},
            # Truth that no stage may learn from: it is here so that the attempt can be run again.
            "simulator": {
                "mujoco": mujoco.__version__,
                "state": self._start_state.tolist(),
                "measurement": to_mapping(self.plant.measurement),
                "q_start_rad": self.scene.q_start_rad.tolist(),
                "T_base_goal": self.scene.T_base_goal.tolist(),
                "orientation_error_rad": self.plant.orientation_error_rad.tolist(),
            },
        }

    def attachments(self, config: Mapping[str, Any]) -> dict[str, Attachment]:
        """The files that a recording of this attempt carries: model, calibration of the rig, and configuration."""
        calibration = {
            "T_flange_sensor": self.rig.sensor.T_flange_sensor,
            "T_flange_tcp": self.rig.T_flange_tcp,
            "payload": to_mapping(self.rig.payload),
            "sensor": to_mapping(self.rig.sensor),
            "cameras": to_mapping(self.rig.cameras),
        }
        return {
            MJCF: Attachment(data=mjcf_of(self.task, self.rig).encode(), media_type="application/xml"),
            MODEL: Attachment(data=model_bytes(self.plant.model), media_type="application/gzip"),
            "calibration.json": _json(calibration),
            "config.json": _json(config),
        }

    def episode(self, id: str, streams: dict[str, Stream], events: list[Event], **meta: Any) -> Episode:
        """The recording of this attempt.

        Args:
            id: Name of the episode.
            streams: Besides those of the plant.
            events: Besides the tare and the success.
            **meta: Besides what is known here: who acted, and all that was configured.
        """
        rows, outcome = self.plant.recorded, self.outcome
        t = rows["t_ns"][:1].copy()
        goal = Stream(t, self.scene.T_base_goal_perceived[None].copy(), POSE, "base")
        return Episode(
            id,
            self.task.name,
            {**streams_of(rows), "goal_pose": goal, **streams},
            (*self.events, *events),
            {**self.meta, **meta, "result": to_mapping(outcome), "safety": self.safety},
            attachments=self.attachments(meta),
        )


def _json(values: Any) -> Attachment:
    return Attachment(data=(json.dumps(values, indent=2) + "\n").encode(), media_type="application/json")


def tick_of_picture(number: int, rate_hz: float) -> int:
    """After how many ticks a picture is taken; picture 0 is taken a period after the start."""
    return math.ceil((number + 1) / rate_hz / TICK_S)


def picture_at(tick: int, rate_hz: float) -> int | None:
    """The picture that is taken after `tick` ticks, or None."""
    near = round(tick * TICK_S * rate_hz) - 1
    return next(
        (number for number in (near, near + 1) if number >= 0 and tick_of_picture(number, rate_hz) == tick), None
    )


def generators(seed: Sequence[int]) -> list[np.random.Generator]:
    """The sources of chance in an attempt: the scene, the plant, whoever acts, and the way of what they send."""
    return np.random.default_rng(tuple(seed)).spawn(4)


def episode_id(task: str, seed: int, index: int, operator: str = "") -> str:
    """Name of an episode, from what determines it and nothing else.

    Args:
        task: That is attempted.
        seed: Of the set of attempts.
        index: Of the attempt in it.
        operator: Who acts, where several may meet the same scenes.
    """
    short = hashlib.sha256("/".join([task, str(seed), *([operator] if operator else [])]).encode()).hexdigest()[:6]
    return f"{task}-{short}-{index:04d}"
