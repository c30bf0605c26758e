"""Devices to steer an arm with: a SpaceMouse and a gamepad, and whether we may read them."""

import os
from dataclasses import dataclass
from pathlib import Path

from wrenchflow.doctor.check import Check
from wrenchflow.spacemouse_models import RULE_FILE, model_of, udev_rule


@dataclass(frozen=True, kw_only=True)
class HidDevice:
    """A device of the hidraw interface.

    Attributes:
        path: Such as `/dev/hidraw0`.
        name: As it calls itself.
        vendor: Number of its maker.
        product: Its number at the maker.
        readable: Whether we may read it.
    """

    path: Path
    name: str
    vendor: int
    product: int
    readable: bool

    @property
    def is_spacemouse(self) -> bool:
        """Whether it has six axes to steer an arm with."""
        return model_of(self.vendor, self.product) is not None


def hid_devices(devices: Path = Path("/dev"), classes: Path = Path("/sys/class/hidraw")) -> list[HidDevice]:
    """All devices of the hidraw interface.

    Args:
        devices: Where the device files are.
        classes: Where the kernel describes them.
    """
    found = []
    for path in sorted(devices.glob("hidraw*")):
        try:
            lines = (classes / path.name / "device" / "uevent").read_text(errors="replace").splitlines()
        except OSError:
            lines = []  # A container may have the device without its description.
        said = dict(line.split("=", 1) for line in lines if "=" in line)
        _, vendor, product = (said.get("HID_ID", "").split(":") + ["0"] * 3)[:3]
        found.append(
            HidDevice(
                path=path,
                name=said.get("HID_NAME", "unknown"),
                vendor=_number(vendor),
                product=_number(product),
                readable=os.access(path, os.R_OK | os.W_OK),  # Nothing is written, but hidapi opens it for both.
            )
        )
    return found


def _number(text: str) -> int:
    try:
        return int(text, 16)
    except ValueError:
        return 0


def check_spacemouse(found: list[HidDevice]) -> Check:
    """Whether there is a SpaceMouse, and whether it can be read.

    Args:
        found: As of `hid_devices`.
    """
    name = "SpaceMouse"
    figures = {
        str(device.path): f"{device.vendor:04x}:{device.product:04x} {device.name}, "
        + ("readable" if device.readable else "not readable")
        for device in found
    }
    mice = [device for device in found if device.is_spacemouse]
    if not mice:
        readable = sum(device.readable for device in found)
        seen = f"no SpaceMouse among {len(found)} HID devices, {readable} readable" if found else "no HID devices"
        return Check(
            name=name,
            state="missing",
            found=seen,
            means="Nobody can steer an arm by hand here; scripted operators need no device.",
            todo="Plug one in; in a container, --device /dev/hidraw0.",
            figures=figures,
        )
    closed = [device for device in mice if not device.readable]
    if closed:
        return Check(
            name=name,
            state="warning",
            found=f"{closed[0].name} at {closed[0].path}, which we may not read",
            means="It is there, but nothing that it says is heard.",
            todo=f"Put the line {udev_rule(closed[0].vendor)} into {RULE_FILE}, run sudo udevadm control --reload, and "
            "plug it in again.",
            figures=figures,
        )
    said = ", ".join(f"{mouse.name} at {mouse.path}" for mouse in mice)
    return Check(name=name, state="ok", found=f"{said}, readable", figures=figures)


def check_gamepad(inputs: Path = Path("/dev/input"), classes: Path = Path("/sys/class/input")) -> Check:
    """Whether the kernel knows a gamepad or joystick, and whether it can be read.

    Args:
        inputs: Where the device files are.
        classes: Where the kernel describes them.
    """
    name = "gamepad"
    pads = {}
    for path in sorted(classes.glob("js*")):
        try:
            label = (path / "device" / "name").read_text(errors="replace").strip()
        except OSError:
            label = "unknown"  # It was unplugged just now.
        # The pad is read through the event file of the same device.
        events = sorted((path / "device").glob("event*"))
        readable = bool(events) and os.access(inputs / events[0].name, os.R_OK)
        pads[str(inputs / path.name)] = (label, readable)
    figures = {path: f"{label}, {'readable' if ok else 'not readable'}" for path, (label, ok) in pads.items()}
    if not pads:
        return Check(
            name=name,
            state="missing",
            found="no gamepad",
            means="Nobody can steer an arm by one here; scripted operators need no device.",
            todo="Plug one in or pair it; in a container, --device /dev/input.",
        )
    said = ", ".join(f"{label} at {path}" for path, (label, _) in pads.items())
    if not all(ok for _, ok in pads.values()):
        return Check(
            name=name,
            state="warning",
            found=f"{said}, which we may not read",
            means="It is there, but nothing that it says is heard.",
            todo="Join the group `input` (sudo usermod -aG input $USER), and log in again.",
            figures=figures,
        )
    return Check(name=name, state="ok", found=f"{said}, readable", figures=figures)
