"""The contact tasks, by name."""

from functools import cache
from typing import Any

from wrenchflow.errors import ConfigError, unknown
from wrenchflow.rig import Rig, load_rig
from wrenchflow.sim.tasks.task import Task

NAMES = ("peg-insertion",)


def make_task(name: str) -> Task:
    """The task of a name.

    Raises:
        ConfigError: If there is none, with the nearest name.
    """
    if name == "peg-insertion":
        from wrenchflow.sim.tasks.peg_insertion import PegInsertion

        return PegInsertion()
    raise ConfigError(unknown("task", name, NAMES))


@cache
def scenery(task: str, rig: str) -> tuple[Task, Rig, Any]:
    """A task, a rig and the model of both; one serves every episode of a process, for nothing writes to it."""
    from wrenchflow.sim.tasks.task import make_model

    made, loaded = make_task(task), load_rig(rig)
    return made, loaded, make_model(made, loaded)
