"""The packages that devices are read with: loaded when one is opened, for most people own one device, or none."""

import importlib
import warnings
from types import ModuleType

from wrenchflow.errors import DeviceError


def load(module: str, *, package: str, device: str) -> ModuleType:
    """Import what a device is read with.

    Args:
        module: As Python calls it.
        package: As it is installed.
        device: What needs it, for the message.

    Raises:
        DeviceError: If it is not there.
    """
    try:
        with warnings.catch_warnings():
            # Some warn of what they themselves import; a person at a device can do nothing about it.
            warnings.simplefilter("ignore")
            return importlib.import_module(module)
    except ImportError as error:
        raise DeviceError(
            f"a {device} is read with the package {package}, which cannot be loaded ({error}): "
            "install wrenchflow[teleop]."
        ) from error
