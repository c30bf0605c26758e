"""A demonstration in real time: ticks by the clock, and every row to the recorder while it happens."""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from wrenchflow import signals
from wrenchflow.camera import View
from wrenchflow.collect.board.row import EVERY_TICKS, Feed
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.demonstration import Demonstration, lost_of, problems_of, refused_of, who_of
from wrenchflow.collect.desk import Desk
from wrenchflow.collect.happenings import Happenings
from wrenchflow.collect.on_clock import OnClock
from wrenchflow.collect.session import Session, known_of
from wrenchflow.collect.sim_camera import SimCamera, views_of
from wrenchflow.collect.tare import tares_of
from wrenchflow.collect.viewer import SceneViewer
from wrenchflow.collect.wishes import REDO
from wrenchflow.config import to_mapping
from wrenchflow.control.controller import TICK_NS
from wrenchflow.control.emergency_stop import EmergencyStop
from wrenchflow.errors import DeviceError, OutputError
from wrenchflow.recording.recorder import Recorder
from wrenchflow.recording.ring import TAP_ROWS, Ring
from wrenchflow.sim.attempt import DEMONSTRATE, MJCF, Attempt, episode_id
from wrenchflow.sim.row import ROW
from wrenchflow.sim.state import Looks, looks_size
from wrenchflow.sim.streams import COLUMNS
from wrenchflow.sim.tasks import scenery
from wrenchflow.source import Column, Source

if TYPE_CHECKING:
    from wrenchflow.view.live import LiveView

_HOLD_TICKS = 500  # Without a writer or a device the arm holds where it is before it is let go of.
PEOPLE_S = 60.0  # How long a person has for an attempt, where nobody says how long.
# What an attempt fails by that somebody ended before it was done, and by what a device does.
ENDED, DISCARDED, LOST = "operator: ended", "operator: discarded", "device: "
_SPIN_NS = 150_000  # A sleep ends late; the last of it is spent awake.

_TIMES = [("t_ns", "i8"), ("received_ns", "i8"), ("sequence", "i8")]
CONTROL = Source(
    name="control",
    dtype=np.dtype([*_TIMES, *((column.name, ROW[column.name]) for column in COLUMNS)], align=True),
    columns=COLUMNS,
)
DEVICE = Source(
    name="device",
    dtype=np.dtype([*_TIMES, ("teleop/joy", "f8", (8,)), ("teleop/twist", "f8", (6,))], align=True),
    columns=(
        Column(name="teleop/joy", signal=signals.JOY, frame="device"),
        Column(name="teleop/twist", signal=signals.TWIST, frame="base"),
    ),
)
GOAL = Source(
    name="goal",
    dtype=np.dtype([*_TIMES, ("goal_pose", "f8", (7,))], align=True),
    columns=(Column(name="goal_pose", signal=signals.POSE, frame="base"),),
    capacity=16,
)


def demonstrate_in_real_time(
    index: int, config: CollectConfig, folder: Path, stop: EmergencyStop | None = None, desk: Desk | None = None
) -> Demonstration:
    """Record one attempt while it happens; it is the attempt that virtual time would have, with other stamps.

    Args:
        index: Number of the episode.
        config: Task, operator, device and gains.
        folder: Where `<id>.mcap` goes.
        stop: What brakes the arm from outside; the attempt then ends as stopped, and is recorded to its end.
        desk: Device, keys, board and window of somebody who demonstrates.

    Raises:
        OutputError: If the recorder cannot begin, or its writer dies; the arm holds first.
    """
    task, rig, model = scenery(config.task, config.rig)
    views = views_of(config, rig)
    name = episode_id(config.task, config.seed, index)
    desk = desk or Desk()
    feed = desk.board.begin(name) if desk.board is not None else None
    known = known_of(config, index)
    if desk.device is not None:
        known["device"] = {"name": desk.device.name, "full_scale_counts": desk.device.full_scale_counts}
    beat: _Beat | None = None
    with ExitStack() as stack:

        def begin(attempt: Attempt) -> "_Beat":
            nonlocal beat
            if stop is not None:
                stop.stops(attempt.controller.stop)
            attachments = attempt.attachments(known)
            control, cameras, taps = CONTROL, [], {}
            if views:
                control = _with_looks(looks_size(model))
                tap = Ring.create(control.dtype, TAP_ROWS)
                stack.callback(tap.unlink)
                stack.callback(tap.close)
                cameras = [SimCamera(attachments[MJCF].data.decode(), views, tap.name, control.dtype)]
                taps = {control.name: tap.name}
            show = _live(name, control, views, attempt) if config.live else None
            if show is not None:
                stack.enter_context(show)
            recorder = Recorder(
                folder / f"{name}.mcap",
                id=name,
                task=task.name,
                sources=[control, DEVICE, GOAL],
                cameras=cameras,
                taps=taps,
                mirrors={view: ring.name for view, ring in show.pictures.items()} if show else None,
                meta={**attempt.meta, **known},
                attachments=attachments,
                compression=config.compression,
            )
            beat = _Beat(stack.enter_context(recorder), control, Looks(attempt.plant.data) if views else None, show)
            beat.watchers = tuple(_watchers(beat, attempt, feed, desk.viewer))
            return beat

        attempt = Attempt(
            task,
            model,
            rig,
            config,
            seed=(config.seed, index, DEMONSTRATE),
            beat=begin,
            tares=tares_of(config, lambda why: _say(desk, f"the tare is refused, and done again: {why}")),
            time_limit_s=config.time_limit_s or (None if desk.device is None else PEOPLE_S),
        )
        assert beat is not None  # An attempt begins its beat before its first tick.
        device = None if desk.device is None else OnClock(desk.device, beat.offset_ns)
        session, happenings = Session(attempt, config, device), Happenings()
        beat.store(GOAL, int(attempt.plant.rows["t_ns"][0]), goal_pose=attempt.scene.T_base_goal_perceived)
        if desk.wishes is not None:
            desk.wishes.begin()
        while not attempt.over and beat.recorder.is_alive:
            try:
                session.period()
            except DeviceError as error:
                attempt.end(f"{LOST}{error}")
                happenings.see(attempt.now_ns, is_marked=False, problem=str(error))
                attempt.follow(_HOLD_TICKS)  # The arm holds where the target was.
                break
            report = session.report
            said = {name: report[name] for name in ("teleop/joy", "teleop/twist")}
            beat.store(DEVICE, int(report["t_ns"]), **said)
            _look(desk, attempt, session, happenings, feed, config.device.patience_s)
        if not beat.recorder.is_alive:
            attempt.follow(_HOLD_TICKS)
        events = (*attempt.events, *session.phases(), *happenings.events(attempt.now_ns - TICK_NS))
        for event in sorted(events):
            beat.recorder.event(event.moved(beat.offset_ns))
        result = {**to_mapping(attempt.outcome), "late_ticks": beat.late}
        recorded = beat.recorder.finish(result, attempt.safety)
        start_m, goal_m = attempt.plant.rows["tcp_pose"][0, :3], attempt.scene.T_base_goal_perceived[:3]
        return Demonstration(
            id=name,
            samples=attempt.plant.count,
            outcome=attempt.outcome,
            who=who_of(known),
            start_m=tuple((start_m - goal_m).tolist()),
            goal_m=tuple(goal_m.tolist()),
            refused=refused_of(attempt.events),
            late_ticks=beat.late,
            lost=lost_of(recorded),
            problems=problems_of(recorded),
        )


def _look(
    desk: Desk, attempt: Attempt, session: Session, happenings: Happenings, feed: Feed | None, patience_s: float
) -> None:
    """After a period: what somebody wants, what went wrong, and what there is to be shown."""
    report = session.report
    gripper, mark = report["teleop/joy"][6:8] > 0.5
    stuck_s = happenings.see(int(report["t_ns"]), is_marked=bool(mark), problem=session.problem)
    if stuck_s > patience_s:
        attempt.end(f"{LOST}{session.problem}")
    if desk.wishes is not None and (ending := desk.wishes.look()):
        attempt.end(DISCARDED if ending == REDO else ENDED)
    if feed is not None:
        buttons = int(gripper) | int(mark) << 1
        phase = int(report["phase"])
        feed.note(phase=phase, buttons=buttons, elapsed_s=attempt.elapsed_s, problem=session.problem)


def _watchers(
    beat: "_Beat", attempt: Attempt, feed: Feed | None, viewer: SceneViewer | None
) -> Iterator[Callable[[int], None]]:
    """Who is told of each tick that is over."""
    if feed is not None:
        ctl, recorder = attempt.controller.ctl, beat.recorder
        yield lambda tick: feed.tick(tick, beat.late, recorder.dropped, ctl) if tick % EVERY_TICKS == 0 else None
    if viewer is not None:
        looks = Looks(attempt.plant.data)
        yield lambda tick: viewer.tick(tick, looks)


def _say(desk: Desk, text: str) -> None:
    if desk.board is not None:
        desk.board.say(text)
    else:
        logging.getLogger("wrenchflow").warning("%s", text)


def _with_looks(size: int) -> Source:
    """The control loop's source where there are cameras: its rows also say what the scene looks like."""
    fields = [(name, CONTROL.dtype[name]) for name in CONTROL.dtype.names or ()]
    return replace(CONTROL, dtype=np.dtype([*fields, ("looks", "f8", (size,))], align=True))


def _live(name: str, control: Source, views: tuple[View, ...], attempt: Attempt) -> "LiveView | None":
    """A live view, or None, which is said, where there is none to be had: a demonstration does not wait for it."""
    from wrenchflow.view.live import LiveView  # Late, for not everybody has a viewer.

    try:
        return LiveView(name, [control, DEVICE, GOAL], views=views, meta=attempt.meta)
    except OutputError as error:
        logging.getLogger("wrenchflow").warning("recorded without a live view: %s", error)
        return None


class _Beat:
    """Called after each tick: stores its row, and waits for the next.

    Attributes:
        recorder: Where rows go.
        offset_ns: From virtual time to the recorder's clock [ns], told at the first tick.
        late: Ticks that began more than a millisecond after their time.
        watchers: Who is told of each tick that is over, by how many there have been.
    """

    def __init__(self, recorder: Recorder, control: Source, looks: Looks | None, show: "LiveView | None") -> None:
        self.recorder, self.offset_ns, self.late = recorder, 0, 0
        self._looks, self._show = looks, show
        self.watchers: tuple[Callable[[int], None], ...] = ()
        self._start_ns = self._ticks = 0
        self._rows = {source.name: np.zeros(1, source.dtype) for source in (control, DEVICE, GOAL)}
        self._counts = dict.fromkeys(self._rows, 0)

    def __call__(self, rows: np.ndarray) -> None:
        """Store the row of a tick that is over."""
        row = rows[-1]
        if not self._ticks:
            self._start_ns = time.monotonic_ns()
            self.offset_ns = self.recorder.clock.at_ns(self._start_ns) - int(row["t_ns"])
        self._ticks += 1
        if self._looks is not None:
            self._looks.into(self._rows[CONTROL.name]["looks"][0])
        self.store(CONTROL, int(row["t_ns"]), **{column.name: row[column.name] for column in COLUMNS})
        for watch in self.watchers:
            watch(self._ticks)
        self._wait(self._start_ns + self._ticks * TICK_NS)

    def store(self, source: Source, t_ns: int, **values: np.ndarray) -> None:
        """Store a row that was sampled at `t_ns` of virtual time."""
        row = self._rows[source.name]
        row["t_ns"] = t_ns + self.offset_ns
        row["received_ns"] = self.recorder.clock.now_ns()
        row["sequence"] = self._counts[source.name]
        self._counts[source.name] += 1
        for name, value in values.items():
            row[name] = value
        self.recorder.push(source.name, row)
        if self._show is not None:
            self._show.push(source.name, row)

    def _wait(self, until_ns: int) -> None:
        left_ns = until_ns - time.monotonic_ns()
        if left_ns < -TICK_NS:
            self.late += 1
        if left_ns > _SPIN_NS:
            time.sleep((left_ns - _SPIN_NS) * 1e-9)
        while time.monotonic_ns() < until_ns:
            pass
