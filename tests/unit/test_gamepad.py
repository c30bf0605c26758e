"""A gamepad through SDL itself: which stick moves what, and what the hand feels."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import wrenchflow
from hands.virtual_pad import VirtualPad
from wrenchflow.collect.devices.gamepad import Gamepad, open_gamepad
from wrenchflow.errors import DeviceError

FULL = 32767
LEFT_X, LEFT_Y, RIGHT_X, RIGHT_Y, LEFT_TRIGGER, RIGHT_TRIGGER = range(6)


@pytest.fixture
def pad() -> Iterator[tuple[VirtualPad, Gamepad]]:
    with pytest.raises(DeviceError, match="no gamepad is there"):
        open_gamepad()  # This loads SDL, too.
    pad = VirtualPad()
    device = open_gamepad()
    yield pad, device
    pad.unplug()
    device.close()


@pytest.mark.parametrize(
    ("axis", "value", "expected"),
    [
        (LEFT_Y, -32768, (FULL, 0, 0, 0, 0, 0)),
        (LEFT_Y, 32767, (-FULL, 0, 0, 0, 0, 0)),
        (LEFT_X, -20000, (0, 20000, 0, 0, 0, 0)),
        (RIGHT_TRIGGER, 32767, (0, 0, FULL, 0, 0, 0)),
        (LEFT_TRIGGER, 32767, (0, 0, -FULL, 0, 0, 0)),
        (RIGHT_Y, -20000, (0, 0, 0, 0, 20000, 0)),
        (RIGHT_X, -20000, (0, 0, 0, 0, 0, 20000)),
    ],
)
def test_each_stick_moves_one_axis(pad, axis, value, expected):
    virtual, device = pad
    assert not device.read(1).counts.any()
    virtual.move(axis, value)
    assert tuple(device.read(2).counts) == expected


@pytest.mark.parametrize(
    ("button", "axis", "count", "buttons"), [(0, 3, 0, 1), (1, 3, 0, 2), (9, 3, -FULL, 0), (10, 3, FULL, 0)]
)
def test_buttons_hold_the_gripper_mark_and_roll(pad, button, axis, count, buttons):
    virtual, device = pad
    virtual.press(button)
    reading = device.read(2)
    assert (reading.counts[axis], reading.buttons) == (count, buttons)
    virtual.press(button, down=False)
    reading = device.read(3)
    assert (reading.counts.any(), reading.buttons, reading.t_ns) == (False, 0, 3)


def test_a_stick_that_is_held_still_goes_on_to_count(pad):
    virtual, device = pad
    virtual.move(LEFT_Y, -10000)
    assert [device.read(t).t_ns for t in (5, 500, 1000)] == [5, 500, 1000]


class Shaken:
    """A pad that only feels: SDL's virtual ones have nothing to rumble with."""

    name = "shaken"

    def __init__(self) -> None:
        self.felt: list[tuple[float, float]] = []

    def rumble(self, low: float, high: float, duration_ms: int) -> bool:
        self.felt.append((low, high))
        return True

    def quit(self) -> None: ...


def test_a_force_is_felt_in_steps_and_ends_with_the_device():
    pad = Shaken()
    device = Gamepad(pad, lambda: None)
    for share in (0.0, 0.5, 0.51, 2.0, -1.0, 1.0):
        device.feel(share)
    device.close()
    device.feel(1.0)
    assert pad.felt == [(0.5, 0.5), (1.0, 1.0), (0.0, 0.0), (1.0, 1.0), (0.0, 0.0)]


def test_what_is_no_pad_is_called_by_its_name():
    with pytest.raises(DeviceError, match="no gamepad is there: none among the joysticks"):
        open_gamepad()
    wheel = VirtualPad(kind=2)  # A steering wheel.
    try:
        with pytest.raises(DeviceError, match=r"no gamepad is there: only .*, whose axes SDL has no table of"):
            open_gamepad()
    finally:
        wheel.unplug()


def test_pygame_neither_greets_on_stdout_nor_takes_signals():
    program = (
        "import signal\n"
        "from wrenchflow.collect.devices.gamepad import open_gamepad\n"
        "from wrenchflow.errors import DeviceError\n"
        "before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]\n"
        "try:\n    open_gamepad()\n"
        "except DeviceError:\n    pass\n"
        "status = open('/proc/self/status').read().split('SigCgt:')[1].split()[0]\n"
        "assert not int(status, 16) >> (signal.SIGTERM - 1) & 1, 'SDL took SIGTERM'\n"
        "assert before == [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]\n"
    )
    source = str(Path(wrenchflow.__file__).parents[1])
    ran = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, env={"PYTHONPATH": source}
    )
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")


def test_a_missing_package_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(DeviceError, match=r"package pygame.*install wrenchflow\[teleop\]"):
        open_gamepad()
