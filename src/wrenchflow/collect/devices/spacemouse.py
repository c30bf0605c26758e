"""A SpaceMouse as the operating system gives it: HID reports, drained to the newest at each read."""

import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np

from wrenchflow.collect.devices import hid_report
from wrenchflow.collect.devices.device import GRIPPER_BUTTON, MARK_BUTTON, Reading
from wrenchflow.collect.devices.needs import load
from wrenchflow.config import require_at_least
from wrenchflow.errors import ConfigError, DeviceError
from wrenchflow.spacemouse_models import MAKER, MAKER_THEN, RULE_FILE, SpaceMouseModel, model_of, udev_rule

_LONGEST_BYTES = 64  # Of any report of a full-speed USB device.
_MOST_REPORTS = 256  # At one read. The kernel keeps 64, so only a driver that repeats itself gets this far.
# The HID usage of a puck; a receiver has further interfaces, for keys and a wheel.
_PAGE, _USAGE = 0x01, 0x08


@runtime_checkable
class Transport(Protocol):
    """Where reports come from: what `hidapi` calls a device."""

    def read(self, length: int, /) -> Sequence[int]:
        """The next report that waits, or nothing; never waits itself. Raises OSError when the device has gone."""
        ...

    def close(self) -> None:
        """Let go."""
        ...


@dataclass(frozen=True, kw_only=True)
class SpaceMouseButtons:
    """Which of its buttons, counted from 0, does what; of the two that every model has, 0 is the left one."""

    gripper: int = 0
    mark: int = 1

    def __post_init__(self) -> None:
        require_at_least(0, gripper=self.gripper, mark=self.mark)
        if max(self.gripper, self.mark) > 47 or self.gripper == self.mark:
            raise ConfigError(
                f"buttons of a SpaceMouse are two different ones from 0 to 47, got {self.gripper} and {self.mark}."
            )


class SpaceMouse:
    """A `TeleopDevice` over HID reports.

    A device repeats its report while it is deflected, and falls silent soon after it is let go of. What waits is taken
    in at every read and only the newest counts, or the arm would go on for as long as the buffer lasts.
    """

    name = "spacemouse"

    def __init__(self, transport: Transport, model: SpaceMouseModel, buttons: SpaceMouseButtons | None = None) -> None:
        """Take a device that is open; `open_spacemouse` finds one."""
        self._transport: Transport | None = transport
        self._model, self._mapping = model, buttons or SpaceMouseButtons()
        self._report = np.zeros(_LONGEST_BYTES, np.uint8)
        self._counts, self._pressed = np.zeros(6, np.int64), np.zeros(1, np.int64)
        self._t_ns, self._problem = 0, ""

    @property
    def full_scale_counts(self) -> int:
        """What an axis of this model reports at full deflection."""
        return self._model.full_scale_counts

    def read(self, now_ns: int) -> Reading:
        """Take in all reports that wait; the newest sound one counts, and a refused one after it is a problem."""
        for _ in range(_MOST_REPORTS):
            report = self._next()
            if not report:
                break
            self._take_in(report, now_ns)
        full = self.full_scale_counts
        pressed = int(self._pressed[0])
        gripper, mark = (pressed >> self._mapping.gripper) & 1, (pressed >> self._mapping.mark) & 1
        return Reading(
            t_ns=self._t_ns,
            counts=np.clip(self._counts, -full, full),
            buttons=gripper << GRIPPER_BUTTON | mark << MARK_BUTTON,
            problem=self._problem,
        )

    def feel(self, share: float) -> None:
        """Nothing: no model can be felt."""

    def close(self) -> None:
        """Let go of it."""
        if self._transport is not None:
            self._transport.close()
        self._transport = None

    def _next(self) -> Sequence[int]:
        if self._transport is None:
            raise DeviceError(f"the {self._model.name} was closed, and cannot be read any more.")
        try:
            return self._transport.read(_LONGEST_BYTES)
        except (OSError, ValueError) as error:
            raise DeviceError(
                f"the {self._model.name} has gone ({error}): plug it in again, or let its battery charge, and start "
                "the episode anew."
            ) from error

    def _take_in(self, report: Sequence[int], now_ns: int) -> None:
        length = len(report)
        kept = min(length, _LONGEST_BYTES)
        self._report[:kept] = np.frombuffer(bytes(report[:kept]), np.uint8)
        code = int(hid_report.decode(self._report, length, self._counts, self._pressed))
        if code == hid_report.SOUND:
            self._t_ns, self._problem = max(self._t_ns, now_ns), ""
        elif code != hid_report.OF_NO_INTEREST:
            self._problem = hid_report.refusal(code, report[0], length)


def open_spacemouse(buttons: SpaceMouseButtons | None = None, *, hidapi: Any = None) -> SpaceMouse:
    """Find and open the first SpaceMouse.

    Args:
        buttons: What its buttons do.
        hidapi: The module that knows the devices, where it is not the machine's own.

    Raises:
        DeviceError: If there is none, or it may not be read; the message says what to do.
    """
    hidapi = hidapi or _hidapi()
    there = list(hidapi.enumerate())
    found = [(info, model) for info in there if (model := _model(info)) is not None]
    if not found:
        raise DeviceError(
            f"no SpaceMouse is there: looked for a 3Dconnexion device (vendor {MAKER:04x}), or one of its older models "
            f"(vendor {MAKER_THEN:04x}), among {len(there)} HID devices. Plug it in and see what `wrenchflow doctor` "
            "finds; a container is given it by --device /dev/hidraw0."
        )
    info, model = found[0]
    device = hidapi.device()
    try:
        device.open_path(info["path"])
        device.set_nonblocking(1)
    except (OSError, ValueError) as error:
        raise DeviceError(_closed(os.fsdecode(info["path"]), info["vendor_id"], model, error)) from error
    return SpaceMouse(device, model, buttons)


def _hidapi() -> Any:
    # On Linux the module `hid` goes through libusb, which takes the device from the kernel and wants other rights;
    # `hidraw`, of the same package, is what the udev rule is for.
    linux = sys.platform.startswith("linux")
    return load("hidraw" if linux else "hid", package="hidapi", device="SpaceMouse")


def _model(info: Mapping[str, Any]) -> SpaceMouseModel | None:
    usage = info.get("usage_page", 0), info.get("usage", 0)
    return model_of(info["vendor_id"], info["product_id"]) if usage in ((_PAGE, _USAGE), (0, 0)) else None


def _closed(path: str, vendor: int, model: SpaceMouseModel, error: Exception) -> str:
    if os.path.exists(path) and not os.access(path, os.R_OK | os.W_OK):
        return (
            f"the {model.name} at {path} may not be read by this user. This udev rule allows it: {udev_rule(vendor)} "
            f"Install it with: echo '{udev_rule(vendor)}' | sudo tee {RULE_FILE} && sudo udevadm control --reload, and "
            "plug the device in again."
        )
    return (
        f"the {model.name} at {path} cannot be opened ({error}): end other programs that hold it, plug it in again, "
        "and see what `wrenchflow doctor` finds."
    )
