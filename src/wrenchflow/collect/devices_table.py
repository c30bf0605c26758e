"""The devices that a person may hold, by name, and what opens each."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.devices.device import TeleopDevice
from wrenchflow.collect.keys import Keys
from wrenchflow.errors import DeviceError
from wrenchflow.kinematics import panda_tcp
from wrenchflow.sim.tasks import scenery


def open_device(config: CollectConfig, keys: Keys) -> TeleopDevice:
    """Open the device that `config.operator` names.

    Args:
        config: Names it, and says what it wants to know.
        keys: Of the terminal, for a keyboard.

    Raises:
        DeviceError: If it is not there or may not be read; the message says what to do.
        RecordingError: If a recording that is to be played again cannot be read.
    """
    return DEVICES[config.operator](config, keys)


def help_of(name: str) -> tuple[str, ...]:
    """What the parts of a device do, in lines for a person; nothing where that is in plain sight."""
    if name == "keyboard":
        from wrenchflow.collect.devices.keyboard import help_lines
    elif name == "gamepad":
        from wrenchflow.collect.devices.gamepad import help_lines
    else:
        return ()
    return help_lines()


def _read_once(device: TeleopDevice) -> TeleopDevice:
    """Find out now whether a device that could be opened has gone, and not in the first attempt."""
    try:
        device.read(0)
    except DeviceError:
        device.close()
        raise
    return device


def _spacemouse(config: CollectConfig, keys: Keys) -> TeleopDevice:
    from wrenchflow.collect.devices.spacemouse import SpaceMouseButtons, open_spacemouse

    buttons = SpaceMouseButtons(gripper=config.device.gripper_button, mark=config.device.mark_button)
    return _read_once(open_spacemouse(buttons))


def _keyboard(config: CollectConfig, keys: Keys) -> TeleopDevice:
    from wrenchflow.collect.devices.keyboard import Holds, Keyboard

    return Keyboard(keys, Holds(first_s=config.device.tap_s))


def _gamepad(config: CollectConfig, keys: Keys) -> TeleopDevice:
    from wrenchflow.collect.devices.gamepad import open_gamepad

    return _read_once(open_gamepad())


def _replay(config: CollectConfig, keys: Keys) -> TeleopDevice:
    from wrenchflow.collect.devices.replay_device import open_replay

    if config.device.recording is None:
        raise DeviceError("nothing is there to be played again: give --device.recording FILE.mcap.")
    return open_replay(config.device.recording, full_scale_counts=config.device.full_scale_counts)


def _lerobot(config: CollectConfig, keys: Keys) -> TeleopDevice:
    from wrenchflow.collect.devices.lerobot_actions import HeldConfig, LeaderConfig
    from wrenchflow.collect.devices.lerobot_teleoperator import connect

    device = config.device
    if not device.kind:
        raise DeviceError("no teleoperator of LeRobot is named: give --device.kind, such as so101_leader or phone.")
    leader = None
    if device.is_leader:
        _, rig, _ = scenery(config.task, config.rig, config.calibration)
        leader = LeaderConfig(
            kinematics=panda_tcp(np.array(rig.T_flange_tcp)),
            units=device.units,
            signs=device.signs,
            offsets_rad=device.offsets_rad,
        )
    settings = dict(setting.split("=", 1) for setting in device.settings)
    held = HeldConfig(scale=device.scale)
    return connect(device.kind, settings, held=held, leader=leader, full_scale=device.full_scale)


DEVICES: Mapping[str, Callable[[CollectConfig, Keys], TeleopDevice]] = MappingProxyType(
    {
        "spacemouse": _spacemouse,
        "keyboard": _keyboard,
        "gamepad": _gamepad,
        "replay": _replay,
        "lerobot": _lerobot,
    }
)
