"""A SpaceMouse on its wire, and how one is found: byte for byte as devices of the maker send them."""

import importlib
import sys
from typing import Any

import numpy as np
import pytest

from hands.wire import Wire, pressed, whole
from wrenchflow.collect.devices.spacemouse import SpaceMouse, SpaceMouseButtons, open_spacemouse
from wrenchflow.errors import ConfigError, DeviceError
from wrenchflow.spacemouse_models import model_of

COMPACT = {"vendor_id": 0x256F, "product_id": 0xC635, "usage_page": 1, "usage": 8, "path": b"/dev/hidraw1"}
KEYBOARD = {"vendor_id": 0x046D, "product_id": 0xC31C, "usage_page": 1, "usage": 6, "path": b"/dev/hidraw0"}


def mouse(*reports: bytes, product: int = 0xC635, **options: Any) -> tuple[Wire, SpaceMouse]:
    model = model_of(0x256F, product)
    assert model is not None
    wire = Wire(*reports)
    return wire, SpaceMouse(wire, model, **options)


@pytest.mark.parametrize(
    ("raw", "counts"),
    [
        # The device's own axes: right, towards the person, down; turns are right-handed about them.
        ((100, 0, 0, 0, 0, 0), (0, -100, 0, 0, 0, 0)),
        ((0, 100, 0, 0, 0, 0), (-100, 0, 0, 0, 0, 0)),
        ((0, 0, 100, 0, 0, 0), (0, 0, -100, 0, 0, 0)),
        ((0, 0, 0, 100, 0, 0), (0, 0, 0, 0, -100, 0)),
        ((0, 0, 0, 0, 100, 0), (0, 0, 0, -100, 0, 0)),
        ((0, 0, 0, 0, 0, 100), (0, 0, 0, 0, 0, -100)),
    ],
)
def test_axes_are_forward_left_and_up(raw, counts):
    report = b"\x01" + np.array(raw, "<i2").tobytes()
    assert tuple(mouse(report)[1].read(5).counts) == counts


def test_the_map_of_axes_is_a_rotation():
    turned = []
    for raw in np.eye(3, dtype=np.int64) * 100:
        turned.append(mouse(b"\x01" + raw.astype("<i2").tobytes())[1].read(5).counts[:3] / 100)
    assert np.linalg.det(np.array(turned)) == pytest.approx(1.0)


def test_half_of_a_split_report_leaves_the_other_half():
    wire, device = mouse(b"\x01" + np.array([0, -50, 0], "<i2").tobytes(), b"\x02" + b"\x00" * 4 + b"\xe2\xff")
    assert device.read(5).counts.tolist() == [50, 0, 0, 0, 0, 30]
    wire.put(b"\x01" + b"\x00" * 6)
    assert device.read(6).counts.tolist() == [0, 0, 0, 0, 0, 30]


def test_two_buttons_are_gripper_and_mark_and_may_be_others():
    reports = [pressed(0b01), pressed(0b10), pressed(0b11), pressed(0)]
    for options, expected in (({}, [1, 2, 3, 0]), ({"buttons": SpaceMouseButtons(gripper=1, mark=0)}, [2, 1, 3, 0])):
        found = [mouse(report, **options)[1].read(5).buttons for report in reports]
        assert found == expected
    _, pro = mouse(pressed(1 << 12, 7), product=0xC632, buttons=SpaceMouseButtons(gripper=12, mark=26))
    assert pro.read(5).buttons == 1
    with pytest.raises(ConfigError, match="two different ones"):
        SpaceMouseButtons(gripper=3, mark=3)


def test_the_battery_is_of_no_interest_and_no_news():
    wire, device = mouse(whole(10, 0, 0, 0, 0, 0))
    device.read(5)
    wire.put(b"\x17\x64")
    reading = device.read(9)
    assert (reading.t_ns, reading.counts[0], reading.problem) == (5, 10, "")


def test_a_driver_that_never_runs_dry_is_left_alone_after_a_while():
    wire, device = mouse(whole(10, 0, 0, 0, 0, 0))
    wire.never_dry = True
    assert device.read(5).counts[0] == 10
    assert wire.reads <= 1000


@pytest.mark.parametrize(
    ("report", "problem"),
    [
        (b"\x01\x02\x03\x04\x05", "a report 1 of 5 bytes, expected 7 or 13"),
        (b"\x02" + b"\x00" * 12, "a report 2 of 13 bytes, expected 7"),
        (b"\x03", "a report 3 of 1 bytes, expected 2 to 7"),
        (b"\x09\x00\x00", "a report of the unknown kind 9, expected 1, 2 or 3"),
        (b"\x01\x00\x80" + b"\x00" * 4, "a report of an axis beyond 2000 counts, which no hand reaches"),
        (b"\x01" * 64, "a report 1 of 64 bytes, expected 7 or 13"),
    ],
)
def test_garbage_is_called_by_its_name(report, problem):
    assert mouse(report)[1].read(5).problem == problem


class Hidapi:
    """The package, as far as it is used: the devices that a test plants."""

    def __init__(self, *infos: dict[str, Any], error: Exception | None = None) -> None:
        self._infos, self._error, self.opened = infos, error, b""
        self.wire = Wire(whole(1, 2, 3, 4, 5, 6))

    def enumerate(self) -> list[dict[str, Any]]:
        return list(self._infos)

    def device(self) -> "Hidapi":
        return self

    def open_path(self, path: bytes) -> None:
        if self._error is not None:
            raise self._error
        self.opened = path

    def set_nonblocking(self, on: int) -> None:
        assert on == 1

    def read(self, length: int, /) -> list[int]:
        return self.wire.read(length)

    def close(self) -> None:
        self.wire.close()


def test_the_puck_is_opened_and_not_what_else_its_receiver_is():
    receiver = {**COMPACT, "product_id": 0xC652}
    wheel = {**receiver, "usage": 2, "path": b"/dev/hidraw1"}
    hidapi = Hidapi(KEYBOARD, wheel, {**receiver, "path": b"/dev/hidraw2"})
    device = open_spacemouse(hidapi=hidapi)
    assert hidapi.opened == b"/dev/hidraw2"
    assert device.full_scale_counts == 500
    assert device.read(5).counts.tolist() == [1, 2, 3, 4, 5, 6]


def test_a_closed_mouse_does_not_read():
    _, device = mouse()
    device.close()
    with pytest.raises(DeviceError, match="was closed"):
        device.read(5)


def test_the_real_package_is_as_it_is_taken_for():
    hidapi = importlib.import_module("hidraw" if sys.platform.startswith("linux") else "hid")
    for info in hidapi.enumerate():
        assert {"vendor_id", "product_id", "usage_page", "usage", "path"} <= info.keys()
    device = hidapi.device()
    with pytest.raises(OSError, match="open"):
        device.open_path(b"/dev/null/hidraw0")
    with pytest.raises((OSError, ValueError)):
        device.read(64)


def test_a_missing_package_is_said(monkeypatch):
    for name in ("hid", "hidraw"):
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(DeviceError, match=r"package hidapi.*install wrenchflow\[teleop\]"):
        open_spacemouse()
