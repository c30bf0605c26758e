"""The contact tasks, by name."""

from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any

from wrenchflow.calibration import calibrated, load_calibration
from wrenchflow.errors import ConfigError, unknown
from wrenchflow.rig import Rig, load_rig
from wrenchflow.sim.tasks.task import Task

# Module and class of each, which are loaded when they are asked for.
_PLACES = MappingProxyType(
    {
        "peg-insertion": ("peg_insertion", "PegInsertion"),
        "surface-wiping": ("surface_wiping", "SurfaceWiping"),
        "connector-insertion": ("connector_insertion", "ConnectorInsertion"),
    }
)
NAMES = tuple(_PLACES)


def make_task(name: str) -> Task:
    """The task of a name.

    Raises:
        ConfigError: If there is none, with the nearest name.
    """
    if name not in _PLACES:
        raise ConfigError(unknown("task", name, NAMES))
    module, kind = _PLACES[name]
    return getattr(import_module(f"{__name__}.{module}"), kind)()


@cache
def scenery(task: str, rig: str | None = None, calibration: Path | None = None) -> tuple[Task, Rig, Any]:
    """A task, a rig, the task's own if none is named, and the model of both.

    One serves every episode of a process, for nothing writes to it. With a calibration the rig has the payload that
    was found; in the model hangs what the rig says.
    """
    from wrenchflow.sim.tasks.task import make_model

    made = make_task(task)
    loaded = load_rig(rig or made.rig)
    believed = loaded if calibration is None else calibrated(loaded, load_calibration(calibration))
    return made, believed, make_model(made, loaded)
