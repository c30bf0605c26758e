"""A demonstration in real time: ticks by the clock, and every row to the recorder while it happens."""

import logging
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from wrenchflow.camera import View
from wrenchflow.collect.beat import Beat
from wrenchflow.collect.board.row import EVERY_TICKS, Feed
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.demonstration import Demonstration, id_of, lost_of, problems_of, refused_of, who_of
from wrenchflow.collect.desk import Desk
from wrenchflow.collect.devices.device import HasSpeeds, TeleopDevice
from wrenchflow.collect.happenings import Happenings
from wrenchflow.collect.on_clock import OnClock
from wrenchflow.collect.session import Session, compliant, known_of
from wrenchflow.collect.sim_camera import SimCamera, views_of
from wrenchflow.collect.sources import CONTROL, DEVICE, GOAL, with_looks
from wrenchflow.collect.tare import tares_of
from wrenchflow.collect.viewer import SceneViewer
from wrenchflow.collect.wishes import REDO
from wrenchflow.config import to_mapping
from wrenchflow.control.controller import TICK_NS
from wrenchflow.control.emergency_stop import EmergencyStop
from wrenchflow.errors import DeviceError, OutputError
from wrenchflow.recording.recorder import Recorder
from wrenchflow.recording.ring import TAP_ROWS, Ring
from wrenchflow.sim.attempt import DEMONSTRATE, MJCF, Attempt
from wrenchflow.sim.state import Looks, looks_size
from wrenchflow.sim.tasks import scenery
from wrenchflow.source import Source

if TYPE_CHECKING:
    from wrenchflow.view.live import LiveView

_HOLD_TICKS = 500  # Without a writer or a device the arm holds where it is before it is let go of.
PEOPLE_S = 60.0  # How long a person has for an attempt, where nobody says how long.
# What an attempt fails by that somebody ended before it was done, and by what a device does.
ENDED, DISCARDED, LOST = "operator: ended", "operator: discarded", "device: "


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
    config = compliant(config)
    task, rig, model = scenery(config.task, config.rig, config.calibration)
    views = views_of(config, rig)
    name = id_of(config, index)
    desk = desk or Desk()
    feed = desk.board.begin(name) if desk.board is not None else None
    known = known_of(config, index)
    if desk.device is not None:
        known["device"] = {"name": desk.device.name, "full_scale_counts": desk.device.full_scale_counts}
    beat: Beat | None = None
    with ExitStack() as stack:

        def begin(attempt: Attempt) -> "Beat":
            nonlocal beat
            if stop is not None:
                stop.stops(attempt.controller.stop)
            attachments = attempt.attachments(known)
            control, cameras, taps = CONTROL, [], {}
            if views:
                control = with_looks(looks_size(model))
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
            beat = Beat(stack.enter_context(recorder), control, Looks(attempt.plant.data) if views else None, show)
            beat.watchers = tuple(_watchers(beat, attempt, feed, desk.device, desk.viewer))
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
        if isinstance(desk.device, HasSpeeds):
            desk.device.slow_down()
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
    if desk.wishes is not None:
        was_last, ending = desk.wishes.is_last, desk.wishes.look(attempt.elapsed_s)
        if desk.wishes.is_last and not was_last:
            _say(desk, "this attempt is the last one.")
        if ending:
            attempt.end(DISCARDED if ending == REDO else ENDED)
    if feed is not None:
        buttons = int(gripper) | int(mark) << 1
        phase = int(report["phase"])
        feed.note(phase=phase, buttons=buttons, elapsed_s=attempt.elapsed_s, problem=session.problem)


def _watchers(
    beat: "Beat", attempt: Attempt, feed: Feed | None, device: TeleopDevice | None, viewer: SceneViewer | None
) -> Iterator[Callable[[int], None]]:
    """Who is told of each tick that is over."""
    if feed is not None:
        ctl, recorder, plant = attempt.controller.ctl, beat.recorder, attempt.plant

        def tell(tick: int) -> None:
            if tick % EVERY_TICKS == 0:
                feed.tick(tick, beat.late, recorder.dropped, ctl, plant.recorded[-1]["tcp_pose"])

        feed.aim(attempt.scene.T_base_goal_perceived, device)
        yield tell
    if viewer is not None:
        looks = Looks(attempt.plant.data)
        yield lambda tick: viewer.tick(tick, looks)


def _say(desk: Desk, text: str) -> None:
    if desk.board is not None:
        desk.board.say(text)
    else:
        logging.getLogger("wrenchflow").warning("%s", text)


def _live(name: str, control: Source, views: tuple[View, ...], attempt: Attempt) -> "LiveView | None":
    """A live view, or None, which is said, where there is none to be had: a demonstration does not wait for it."""
    from wrenchflow.view.live import LiveView  # Late, for not everybody has a viewer.

    try:
        return LiveView(name, [control, DEVICE, GOAL], views=views, meta=attempt.meta)
    except OutputError as error:
        logging.getLogger("wrenchflow").warning("recorded without a live view: %s", error)
        return None
