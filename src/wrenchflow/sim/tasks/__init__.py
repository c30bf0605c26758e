"""The contact tasks, by name."""

from wrenchflow.errors import ConfigError, unknown
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
