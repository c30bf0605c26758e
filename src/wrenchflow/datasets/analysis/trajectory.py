"""An episode of any data set, as an analysis looks at it: tables of named columns, and what is said about it."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float

# What a table may hold; those that are felt come in this order, the best witness first.
WRENCH, WRENCH_RAW, ESTIMATED = "wrench", "wrench_raw", "estimated_external_wrench"
JOINT_TORQUE, ACTION, STATE, TIMING = "joint_torque", "action", "state", "timing"

WRENCH_COLUMNS = ("fx", "fy", "fz", "tx", "ty", "tz")
WRENCH_UNITS = ("N",) * 3 + ("N.m",) * 3


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Rows of some columns.

    Attributes:
        columns: Their names.
        units: Their units; empty where nobody says.
        data: One row a sample. Shape (n, d).
    """

    columns: tuple[str, ...]
    units: tuple[str, ...]
    data: Float[np.ndarray, "n d"]


@dataclass(frozen=True, kw_only=True)
class Labels:
    """What is said about an episode, by which episodes are compared; empty where nobody says.

    Attributes:
        task: What was to be done.
        lab: Where.
        collector: Who demonstrated.
        scene: In which scene.
        success: What came of it; None where nobody says.
    """

    task: str = ""
    lab: str = ""
    collector: str = ""
    scene: str = ""
    success: bool | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """An episode.

    Attributes:
        id: Its name, unique in its data set.
        place: Where it is, relative to the data set.
        labels: What is said about it.
        seconds: Time of each step since the first [s]; None where nobody says. Shape (T,).
        nominal_hz: How many steps a second there should be [Hz]; None where nobody says.
        is_timed: Whether `seconds` are when something was measured, and not numbers that a writer made up.
        position_m: Of the tool, in the base frame [m]. Shape (T, 3).
        joints_rad: Joint angles [rad]. Shape (T, j).
        tables: By `WRENCH`, `JOINT_TORQUE` and so on; each has rows of its own.
        contact: Whether something is touched, a row of the table that says it. Shape (n,).
        contact_by: What says it: `contact_by` names a table, or is empty where nothing does.
        estimate_std: Standard uncertainty of each row of the estimate. Shape (n, 6).
        counts: Things that are counted, such as steps that were skipped.
        missing: What the data set should have of it and has not.
    """

    id: str
    place: str
    labels: Labels = field(default_factory=Labels)
    seconds: Float[np.ndarray, " T"] | None = None
    nominal_hz: float | None = None
    is_timed: bool = False
    position_m: Float[np.ndarray, "T 3"] | None = None
    joints_rad: Float[np.ndarray, "T j"] | None = None
    tables: Mapping[str, Table] = field(default_factory=dict)
    contact: Bool[np.ndarray, " n"] | None = None
    contact_by: str = ""
    estimate_std: Float[np.ndarray, "n 6"] | None = None
    counts: Mapping[str, int] = field(default_factory=dict)
    missing: tuple[str, ...] = ()
