"""How much of what can happen demonstrations have shown: where they started, where to, by whom, how it ended."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Float

from wrenchflow.collect.demonstration import Demonstration
from wrenchflow.kinematics import panda_tcp
from wrenchflow.sim.attempt import CHECK, generators
from wrenchflow.sim.tasks import scenery

BINS = 3  # Along each axis in which a task draws: 27 of a box, 9 of a plane.
_DRAWS = 200
_FLAT_M = 1e-6  # An axis along which less is drawn has no bins.

Cell = tuple[int, ...]


@dataclass(frozen=True, kw_only=True)
class Box:
    """Where a task puts something, cut into cells; what lies outside belongs to the nearest of them.

    Attributes:
        low_m: Lowest corner [m].
        high_m: Highest corner [m].
    """

    low_m: tuple[float, ...]
    high_m: tuple[float, ...]

    @classmethod
    def around(cls, points_m: Float[np.ndarray, "n d"]) -> "Box":
        """The smallest box around some points. Shape (n, d)."""
        return cls(low_m=tuple(points_m.min(axis=0).tolist()), high_m=tuple(points_m.max(axis=0).tolist()))

    @property
    def cells(self) -> int:
        """How many there are."""
        return BINS ** sum(high - low > _FLAT_M for low, high in zip(self.low_m, self.high_m, strict=True))

    def cell(self, point_m: Iterable[float]) -> Cell:
        """Which of them a point lies in, counted from 0 along each axis."""
        return tuple(
            min(max(int((x - low) / (high - low) * BINS), 0), BINS - 1) if high - low > _FLAT_M else 0
            for x, low, high in zip(point_m, self.low_m, self.high_m, strict=True)
        )


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """What has been shown so far. A value: `with_` gives another one.

    Attributes:
        starts_box: Where the task lets the TCP start, from the goal as it is perceived.
        goals_box: Where it puts the goal, as it is perceived.
        starts: Cells that somebody started from.
        goals: Cells that a goal was in.
        tried: Attempts, by who made them.
        done: Those that succeeded.
    """

    starts_box: Box
    goals_box: Box
    starts: frozenset[Cell] = frozenset()
    goals: frozenset[Cell] = frozenset()
    tried: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    done: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))

    def with_(self, shown: Demonstration) -> "Coverage":
        """With one more."""
        one = Coverage(
            starts_box=self.starts_box,
            goals_box=self.goals_box,
            starts=frozenset({self.starts_box.cell(shown.start_m)}),
            goals=frozenset({self.goals_box.cell(shown.goal_m)}),
            tried=MappingProxyType({shown.who: 1}),
            done=MappingProxyType({shown.who: int(shown.outcome.success)}),
        )
        return self | one

    def __or__(self, other: "Coverage") -> "Coverage":
        """What both have shown, of different demonstrations of one task."""
        assert (self.starts_box, self.goals_box) == (other.starts_box, other.goals_box)  # Of one task.
        return Coverage(
            starts_box=self.starts_box,
            goals_box=self.goals_box,
            starts=self.starts | other.starts,
            goals=self.goals | other.goals,
            tried=_sum(self.tried, other.tried),
            done=_sum(self.done, other.done),
        )

    def __reduce__(self):  # A MappingProxyType does not pickle, and a board may be drawn by another process.
        return _made, (self.starts_box, self.goals_box, self.starts, self.goals, dict(self.tried), dict(self.done))

    def to_mapping(self) -> dict[str, Any]:
        """Plain figures: cells that were seen of those there are, and successes of attempts by who made them."""
        return {
            "starts": [len(self.starts), self.starts_box.cells],
            "goals": [len(self.goals), self.goals_box.cells],
            "successes_by": {who: [self.done.get(who, 0), count] for who, count in sorted(self.tried.items())},
        }


def _made(
    starts_box: Box,
    goals_box: Box,
    starts: frozenset[Cell],
    goals: frozenset[Cell],
    tried: dict[str, int],
    done: dict[str, int],
) -> Coverage:
    return Coverage(
        starts_box=starts_box,
        goals_box=goals_box,
        starts=starts,
        goals=goals,
        tried=MappingProxyType(tried),
        done=MappingProxyType(done),
    )


def empty_coverage(task: str, rig: str | None = None) -> Coverage:
    """Nothing shown yet of a task, in the boxes that two hundred scenes of it span, which nobody demonstrates.

    Raises:
        ConfigError: If there is no such task or rig.
    """
    made, loaded, model = scenery(task, rig)
    starts, goals, tcp_pose = [], [], panda_tcp(np.array(loaded.T_flange_tcp))
    for index in range(_DRAWS):
        scene = made.draw(model, generators((0, index, CHECK))[0])
        goals.append(scene.T_base_goal_perceived[:3])
        starts.append(tcp_pose(scene.q_start_rad)[:3] - goals[-1])
    return Coverage(starts_box=Box.around(np.array(starts)), goals_box=Box.around(np.array(goals)))


def _sum(a: Mapping[str, int], b: Mapping[str, int]) -> Mapping[str, int]:
    return MappingProxyType({name: a.get(name, 0) + b.get(name, 0) for name in sorted({*a, *b})})
