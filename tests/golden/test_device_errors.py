"""What a person reads whose device is not there, may not be read, or has gone, word for word."""

import os

import pytest

from hands.wire import Wire
from wrenchflow.collect.devices.spacemouse import SpaceMouse, open_spacemouse
from wrenchflow.errors import DeviceError
from wrenchflow.spacemouse_models import model_of

KEYBOARD = {"vendor_id": 0x046D, "product_id": 0xC31C, "usage_page": 1, "usage": 6, "path": b"/dev/hidraw0"}


class Hidapi:
    """A machine with these devices, of which none can be opened."""

    def __init__(self, *infos: dict) -> None:
        self._infos = infos

    def enumerate(self) -> list[dict]:
        return list(self._infos)

    def device(self) -> "Hidapi":
        return self

    def open_path(self, path: bytes) -> None:
        raise OSError("open failed")


def absent() -> None:
    open_spacemouse(hidapi=Hidapi(KEYBOARD))


def unplugged() -> None:
    model = model_of(0x046D, 0xC626)
    assert model is not None
    wire = Wire()
    wire.unplug()
    SpaceMouse(wire, model).read(1)


@pytest.mark.parametrize(
    ("act", "text"),
    [
        (
            absent,
            "no SpaceMouse is there: looked for a 3Dconnexion device (vendor 256f), or one of its older models (vendor "
            "046d), among 1 HID devices. Plug it in and see what `wrenchflow doctor` finds; a container is given it by "
            "--device /dev/hidraw0.",
        ),
        (
            unplugged,
            "the SpaceNavigator has gone (read error): plug it in again, or let its battery charge, and start the "
            "episode anew.",
        ),
    ],
)
def test_a_mouse_that_is_not_there_reads_so(act, text):
    with pytest.raises(DeviceError) as error:
        act()
    assert str(error.value) == text


@pytest.mark.parametrize(
    ("may_read", "text"),
    [
        (
            False,
            "the SpaceMouse Compact at <path> may not be read by this user. This udev rule allows it: "
            'KERNEL=="hidraw*", ATTRS{idVendor}=="256f", MODE="0660", TAG+="uaccess" Install it with: echo '
            '\'KERNEL=="hidraw*", ATTRS{idVendor}=="256f", MODE="0660", TAG+="uaccess"\' | sudo tee '
            "/etc/udev/rules.d/70-spacemouse.rules && sudo udevadm control --reload, and plug the device in again.",
        ),
        (
            True,
            "the SpaceMouse Compact at <path> cannot be opened (open failed): end other programs that hold it, plug it "
            "in again, and see what `wrenchflow doctor` finds.",
        ),
    ],
)
def test_a_mouse_that_does_not_open_reads_so(tmp_path, monkeypatch, may_read, text):
    path = tmp_path / "hidraw1"
    path.touch()
    # Root may read everything, so the answer is planted, and not the rights.
    monkeypatch.setattr("wrenchflow.collect.devices.spacemouse.os.access", lambda path, mode: may_read)
    compact = {"vendor_id": 0x256F, "product_id": 0xC635, "usage_page": 1, "usage": 8, "path": os.fsencode(path)}
    with pytest.raises(DeviceError) as error:
        open_spacemouse(hidapi=Hidapi(KEYBOARD, compact))
    assert str(error.value).replace(str(path), "<path>") == text
