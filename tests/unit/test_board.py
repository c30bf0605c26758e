"""What a board shows, as text: every fact that a person needs is there, and a terminal is left as it was."""

import io
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from hands.typist import Typist
from wrenchflow.collect.board import screen
from wrenchflow.collect.board.board import Lines
from wrenchflow.collect.board.look import Facts, look
from wrenchflow.collect.board.row import EVERY_TICKS, ROW, ROWS_WAITING, Feed
from wrenchflow.collect.board.screen import Screen
from wrenchflow.collect.board.tally import Tally, told
from wrenchflow.collect.board.tone import Tone
from wrenchflow.collect.coverage import Box, Coverage
from wrenchflow.collect.demonstration import Demonstration
from wrenchflow.collect.devices.keyboard import Keyboard
from wrenchflow.collect.devices_table import help_of
from wrenchflow.collect.sitting import _MEND
from wrenchflow.collect.wishes import HELP
from wrenchflow.control.records import CTL
from wrenchflow.control.safeguards import MODES
from wrenchflow.recording.ring import Ring
from wrenchflow.sim.attempt import Outcome
from wrenchflow.spatial import IDENTITY_POSE, exp_so3, make_pose, rotation_of

BOX = Box(low_m=(0.0, 0.0, 0.0), high_m=(1.0, 1.0, 0.0))
NOTHING = Tally(total=4, coverage=Coverage(starts_box=BOX, goals_box=BOX))
FACTS = Facts(
    title="keyboard: peg-insertion",
    limit_n=40.0,
    full_speed_m_s=0.2,
    modes=("run", "hold"),
    phases=("approach", "insert"),
    help=("w: forward", "escape: stop"),
)


def shown(success=True, **more) -> Demonstration:
    outcome = Outcome(success=success, duration_s=4.2, progress=0.0, failure="" if success else "jammed")
    values = {"id": "peg-0001", "samples": 5200, "who": "steady", "start_m": (0.1, 0.1, 0.0), "goal_m": (0.9, 0.1, 0.0)}
    return Demonstration(outcome=outcome, **{**values, **more})


def row(force_n=0.0, **more):
    made = np.zeros(1, ROW)[0]
    made["wrench"][2], made["phase"] = force_n, -1
    for name, value in more.items():
        made[name] = value
    return made


def text_of(*args, width=100, facts=FACTS, **more) -> str:
    console = Console(file=io.StringIO(), width=width, record=True)
    console.print(look(facts, *args, **more))
    return console.export_text()


def test_a_tally_counts_what_is_kept_failed_and_discarded():
    tally = NOTHING.with_(shown()).with_(shown(success=False)).without(shown())
    assert (tally.kept, tally.failed, tally.discarded) == (2, 1, 1)
    assert tally.simulated_s == pytest.approx(15.6)
    assert tally.coverage.tried == {"steady": 2}
    assert NOTHING.kept == 0
    # What an earlier run recorded took no time of this one.
    assert NOTHING.with_(shown(was_there=True)).simulated_s == 0.0


def test_all_that_a_person_needs_is_there():
    tally = NOTHING.with_(shown()).with_(shown(success=False)).without(shown())
    said = row(-12.5, is_under_way=1, phase=1, buttons=3, late=7, lost=2, elapsed_s=3.25, mode=1)
    text = text_of(tally, "peg-0002", said, 998.0)
    for part in (
        *("keyboard: peg-insertion", "episode 3 of 4", "peg-0002", "998 Hz", "3.2 s", "insert", "hold"),
        *("late 7", "dropped 2", "gripper", "mark", "-12.5 N", "12.5 N", "^ 40 N"),
        *("2 kept (1 of them failed), 1 discarded", "starts 1 of 9 cells", "steady 1/2"),
        *("w: forward", "escape: stop"),
    ):
        assert part in text, part
    asked = text_of(tally, "peg-0002", said, 998.0, "keep it?")
    assert "keep it?" in asked
    assert "escape: stop" not in asked  # Keys that mean something else now.
    assert "tare: hands off" in text_of(tally, "a", row())
    assert "the clock jumped: the arm holds" in text_of(tally, "a", row(problem=b"the clock jumped"))


@pytest.mark.parametrize(
    ("force_n", "cells"), [(0.0, 0), (20.0, 16), (40.0, 32), (50.0, 40), (500.0, 40), (np.nan, 40)]
)
def test_bars_are_as_long_as_the_force_and_end_at_their_end(force_n, cells):
    lines = [line for line in text_of(NOTHING, "a", row(force_n)).splitlines() if "|f|" in line]
    assert len(lines) == 1
    assert lines[0].count("█") + lines[0].count("▌") == cells


@pytest.mark.parametrize("width", [20, 60, 200])
def test_no_line_is_wider_than_the_terminal(width):
    lines = text_of(NOTHING, "a" * 80, row(), width=width).splitlines()
    assert max(len(line) for line in lines) <= width


def test_nothing_wraps_on_a_small_terminal(monkeypatch):
    people = {name: 200 for name in ("steady", "brisk", "gentle", "heavy", "novice")}
    full = Coverage(starts_box=BOX, goals_box=BOX, tried=people, done=people)
    tally = Tally(total=1000, coverage=full, kept=999, failed=999, discarded=999)
    away = make_pose(np.array([-0.9, -0.9, 0.9]), exp_so3(np.array([0.0, 0.0, 3.0])))
    worst = row(
        -1000.0,
        is_under_way=1,
        buttons=3,
        late=9999,
        lost=9999,
        elapsed_s=999.0,
        mode=1,
        speed_name=b"4",
        tcp_pose=away,
    )
    worst["goal_pose"] = IDENTITY_POSE
    for helped in (help_of("keyboard"), help_of("gamepad")):
        facts = replace(FACTS, modes=MODES, help=(*helped, *HELP))
        for mode in range(len(MODES)):
            worst["mode"] = mode
            for question in ("", _MEND):
                what = (tally, "connector-insertion-0000ff-0999", worst, 1000.0, question)
                monkeypatch.setattr("wrenchflow.collect.board.look._WIDTH", 300)
                wide = text_of(*what, facts=facts, width=300)
                monkeypatch.undo()
                small = text_of(*what, facts=facts, width=80)
                assert small.count("\n") == wide.count("\n") <= 22


def test_where_the_tool_is_from_the_goal_is_said_in_the_axes_that_it_is_steered_in():
    goal = make_pose(np.array([0.5, 0.1, 0.2]), exp_so3(np.array([np.pi, 0.0, 0.0])))
    turned = exp_so3(np.array([0.0, 0.0, np.radians(12.5)])) @ rotation_of(goal[3:])
    tool = make_pose(goal[:3] + [0.012, -0.0034, 0.05], turned)
    text = text_of(NOTHING, "a", row(tcp_pose=tool, goal_pose=goal))
    assert "x   +12.0   y    -3.4   z   +50.0 mm   yaw  +12.5°" in text
    assert "from the goal" not in text_of(NOTHING, "a", row(tcp_pose=tool))


def test_the_speed_is_said_that_a_key_or_a_full_deflection_means():
    assert "speed 2: 60 mm/s" in text_of(NOTHING, "a", row(speed_name=b"2", speed_share=0.3))
    assert "speed: 200 mm/s at most" in text_of(NOTHING, "a", row(speed_share=1.0))


def test_a_line_says_what_became_of_an_episode():
    assert told(shown()) == "peg-0001  steady  4.2 s  success"
    line = told(shown(success=False, refused=("it moved",), late_ticks=3, lost=1))
    assert line == "peg-0001  steady  4.2 s  failed: jammed; tare refused: it moved; 3 late ticks; 1 rows lost"


def test_lines_are_one_an_episode_and_nothing_fancy(capsys):
    with Lines(NOTHING) as board:
        assert board.begin("peg-0001") is None
        board.add(shown(was_there=True))
        board.discard(shown(success=False))
        board.add(shown())
        board.say("the tare is refused")
        board.ask("")
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "discarded  peg-0001  steady  4.2 s  failed: jammed",
        "2 of 4  peg-0001  steady  4.2 s  success",
        "the tare is refused",
    ]


def test_a_screen_gives_the_cursor_back_whatever_happens(monkeypatch):
    written = io.StringIO()
    real = screen.Console
    monkeypatch.setattr(screen, "Console", lambda file: real(file=written, force_terminal=True, width=90))

    def interrupted() -> None:
        with Screen(FACTS, NOTHING) as board:
            board.add(shown(refused=("it moved",)))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    out = written.getvalue()
    assert out.rindex("\x1b[?25h") > out.rindex("\x1b[?25l")
    assert "tare refused: it moved" in out
    assert "1 kept" in out


def test_a_feed_tells_now_and_then_and_what_was_noted_goes_along():
    typist = Typist(has_releases=True)
    keyboard = Keyboard(typist)
    typist.press("3")
    keyboard.read(1)
    ring, ctl, pose = Ring.create(ROW, ROWS_WAITING), np.zeros(1, CTL), np.arange(7.0)
    try:
        feed = Feed(ring)
        ctl[0]["wrench"] = np.arange(6)
        feed.aim(2.0 * pose, keyboard)
        feed.note(phase=1, buttons=2, elapsed_s=0.5, problem="the device is silent" + "x" * 500)
        for tick in range(1, 4 * EVERY_TICKS + 1):
            feed.tick(tick, 3, 4, ctl, pose)
        rows = ring.take()
    finally:
        ring.close()
        ring.unlink()
    assert rows["tick"].tolist() == [EVERY_TICKS * k for k in (1, 2, 3, 4)]
    last = rows[-1]
    assert (last["late"], last["lost"], last["phase"], last["buttons"], last["is_under_way"]) == (3, 4, 1, 2, 1)
    assert last["problem"].startswith(b"the device is silent")
    np.testing.assert_array_equal(last["wrench"], np.arange(6))
    np.testing.assert_array_equal(last["tcp_pose"], pose)
    np.testing.assert_array_equal(last["goal_pose"], 2.0 * pose)
    assert (last["speed_name"], last["speed_share"]) == (b"3", 0.6)


def test_a_tone_is_silent_below_half_of_the_limit_and_faster_towards_it():
    now_s, beeps = [0.0], []
    tone = Tone(lambda: beeps.append(now_s[0]), lambda: now_s[0])

    def heard(share) -> int:
        beeps.clear()
        now_s[0] += 10.0
        for _ in range(1000):
            now_s[0] += 0.01
            tone.hear(share)
        return len(beeps)

    assert heard(0.49) == heard(float("nan")) == 0
    counts = [heard(share) for share in (0.5, 0.75, 1.0)]
    assert counts == sorted(counts)
    assert counts[0] >= 10
    assert heard(100.0) == counts[-1] <= 51
