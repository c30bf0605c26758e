"""All checks, in the order in which they are told."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

from wrenchflow.doctor.check import Check
from wrenchflow.doctor.devices import check_gamepad, check_spacemouse, hid_devices
from wrenchflow.doctor.disk import check_disk
from wrenchflow.doctor.machine import check_governor, check_processors, check_python
from wrenchflow.doctor.packages import OPTIONAL, check_gpu, check_package
from wrenchflow.doctor.realtime import check_memory_lock, check_scheduling, check_timer
from wrenchflow.doctor.rendering import check_rendering, check_simulator
from wrenchflow.doctor.shared_memory import check_shared_memory


def checks(folder: Path) -> Mapping[str, Callable[[], Check]]:
    """Everything that is looked at, by a short name.

    Args:
        folder: Where recordings would go.
    """
    return {
        "python": check_python,
        "processor": check_processors,
        "governor": check_governor,
        "timer": check_timer,
        "scheduling": check_scheduling,
        "memory lock": check_memory_lock,
        "shared memory": check_shared_memory,
        "disk": partial(check_disk, folder),
        "spacemouse": lambda: check_spacemouse(hid_devices()),
        "gamepad": check_gamepad,
        "simulator": check_simulator,
        "egl": partial(check_rendering, "egl"),
        "osmesa": partial(check_rendering, "osmesa"),
        "gpu": check_gpu,
        **{package: partial(check_package, package) for package in OPTIONAL},
    }
