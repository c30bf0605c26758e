"""Which skill belongs to which task; compiled code takes a number for a name."""

from types import MappingProxyType

import numpy as np

from wrenchflow.collect.skills import peg, plug, wipe
from wrenchflow.collect.skills.skill import make_skill
from wrenchflow.compiled import kernel
from wrenchflow.control.config import Impedance
from wrenchflow.errors import ConfigError, unknown

_PEG, _WIPE, _PLUG = np.int64(0), np.int64(1), np.int64(2)
_SKILLS = MappingProxyType(
    {
        "peg-insertion": (_PEG, peg.TRAITS),
        "surface-wiping": (_WIPE, wipe.TRAITS),
        "connector-insertion": (_PLUG, plug.TRAITS),
    }
)


@kernel
def want(number, skill, seen, wanted):
    """Decide, in the goal's axes; records `SKILL`, `PERCEIVED` and `WANTED`."""
    wanted.is_reach = 0
    if number == _PEG:
        peg.want(skill, seen, wanted)
    elif number == _WIPE:
        wipe.want(skill, seen, wanted)
    elif number == _PLUG:
        plug.want(skill, seen, wanted)


def skill_of(task: str, impedance: Impedance) -> tuple[int, np.ndarray]:
    """Number and `SKILL` record, shape (1,), of the skill for a task, as the most careful person would do it.

    Raises:
        ConfigError: If nobody knows how to do this task.
    """
    if task not in _SKILLS:
        raise ConfigError(unknown("skill", task, _SKILLS))
    number, traits = _SKILLS[task]
    return int(number), make_skill(impedance, **traits)
