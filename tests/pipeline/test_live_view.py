"""A live view gets a part of what is pushed, and whatever happens to it, the control loop goes on."""

import os
import signal
import socket
import sys
import time

import numpy as np
import pytest

from wrenchflow.camera import View
from wrenchflow.errors import OutputError
from wrenchflow.signals import POSE, WRENCH
from wrenchflow.source import Column, Source
from wrenchflow.view.feed import ROWS_WAITING, Decimation
from wrenchflow.view.live import LiveView

TICK_NS = 1_000_000
START_NS = 1_700_000_000_000_000_000
ROW = np.dtype([("t_ns", "i8"), ("tcp_pose", "f8", (7,)), ("wrench", "f8", (6,))], align=True)
CONTROL = Source(
    name="control",
    dtype=ROW,
    columns=(
        Column(name="tcp_pose", signal=POSE, frame="base"),
        Column(name="wrench", signal=WRENCH, frame="base", lag_ns=TICK_NS),
    ),
)
GOAL = Source(
    name="goal",
    dtype=np.dtype([("t_ns", "i8"), ("goal_pose", "f8", (7,))], align=True),
    columns=(Column(name="goal_pose", signal=POSE, frame="base"),),
)
WRIST = View(name="wrist", width=32, height=24)


def ticks(count: int) -> np.ndarray:
    rows, rng = np.zeros(count, ROW), np.random.default_rng(0)
    rows["t_ns"] = START_NS + np.arange(count) * TICK_NS
    rows["tcp_pose"], rows["wrench"] = rng.normal(size=(count, 7)), rng.normal(size=(count, 6))
    return rows


def push(view: LiveView, rows: np.ndarray, pace_s: float = 0.0) -> None:
    for number in range(len(rows)):
        view.push("control", rows[number : number + 1])
        time.sleep(pace_s)


def test_what_is_pushed_comes_fifty_times_a_second(tmp_path, rerun_columns):
    rows, out = ticks(1000), tmp_path / "live.rrd"
    goal, picture = np.zeros(1, GOAL.dtype), np.zeros(1, WRIST.row)
    goal["t_ns"], goal["goal_pose"] = START_NS, np.arange(7)
    with LiveView("7", [CONTROL, GOAL], views=[WRIST], save=out) as view:
        view.push("goal", goal)
        for k in range(4):
            content = bytes([0xFF, 0xD8, 0xFF, k])
            picture["t_ns"], picture["size"] = START_NS + k * 40 * TICK_NS, len(content)
            picture["data"][0, : len(content)] = list(content)
            view.pictures["wrist"].push(picture)
        push(view, rows)
        assert view.dropped == 0
        assert not out.exists()
    seen = rows[::20]
    shown = rerun_columns(out, "time")
    t, force = shown["/wrench/force", "Scalars:scalars"]
    np.testing.assert_array_equal(t, seen["t_ns"][1:] - TICK_NS)  # The first row's wrench is of before the start.
    np.testing.assert_array_equal(force, seen["wrench"][1:, :3])
    t, position = shown["/tcp_pose/position", "Scalars:scalars"]
    np.testing.assert_array_equal(t, seen["t_ns"])
    np.testing.assert_array_equal(position, seen["tcp_pose"][:, :3])
    np.testing.assert_array_equal(shown["/goal_pose/orientation", "Scalars:scalars"][1], [[3, 4, 5, 6]])
    t, pictures = shown["/camera/wrist", "EncodedImage:blob"]
    np.testing.assert_array_equal(t - START_NS, [0, 120 * TICK_NS])  # Ten a second at most.
    assert pictures == [[[0xFF, 0xD8, 0xFF, 0]], [[0xFF, 0xD8, 0xFF, 3]]]


def test_when_its_process_dies_pushes_go_nowhere(tmp_path):
    rows, out = ticks(4000), tmp_path / "live.rrd"
    with LiveView("7", [CONTROL], save=out) as view:
        push(view, rows[:100])
        os.kill(view.pid, signal.SIGKILL)
        push(view, rows[100:])  # Twenty times a row, where the ring holds two seconds of them.
        assert view.dropped > 0
    assert not out.exists()
    assert (tmp_path / "live.rrd.partial").exists()


def test_a_ring_that_nobody_drains_drops_and_counts(tmp_path):
    with LiveView("7", [CONTROL], save=tmp_path / "live.rrd") as view:
        os.kill(view.pid, signal.SIGSTOP)
        push(view, ticks(20 * (ROWS_WAITING + 5)))
        assert view.dropped == 5
        os.kill(view.pid, signal.SIGCONT)
    assert (tmp_path / "live.rrd").exists()


@pytest.mark.slow
def test_a_port_that_listens_but_is_no_viewer_disturbs_nobody():
    with (
        socket.create_server(("127.0.0.1", 0)) as other,
        LiveView("7", [CONTROL], port=other.getsockname()[1]) as view,
    ):
        push(view, ticks(500))


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere there is always a display")
def test_without_a_display_it_does_not_begin(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    with pytest.raises(OutputError, match="no display"):
        LiveView("7", [CONTROL], port=port)


def test_a_file_that_is_there_is_not_replaced(tmp_path):
    (tmp_path / "live.rrd").write_text("mine")
    with pytest.raises(OutputError, match="exists already"):
        LiveView("7", [CONTROL], save=tmp_path / "live.rrd")
    assert (tmp_path / "live.rrd").read_text() == "mine"


def test_decimation_counts_time_and_begins_anew_with_a_clock_that_was_set_back():
    decimation = Decimation(50.0)
    passed = [t for t in range(0, 100 * TICK_NS, TICK_NS) if decimation.passes(START_NS + t)]
    assert passed == [k * 20 * TICK_NS for k in range(5)]
    assert decimation.passes(START_NS - 60_000_000_000)
    assert not decimation.passes(START_NS - 60_000_000_000 + TICK_NS)
    assert decimation.passes(START_NS)
