"""What became of a recorded attempt, in figures: as it was made, or as its file says it."""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from wrenchflow.collect.config import CollectConfig
from wrenchflow.episode import Episode, Event
from wrenchflow.recording.recording import Recording
from wrenchflow.sim.attempt import Outcome, episode_id

TARE = "tare"  # Kind of the events of tares that were refused.


@dataclass(frozen=True, kw_only=True)
class Demonstration:
    """What became of one recorded attempt.

    Attributes:
        id: Of the episode.
        samples: At 1 kHz.
        outcome: Done or not.
        who: The operator, or the profile of an emulated one.
        start_m: Where the TCP started, from the goal as it is perceived, base axes [m].
        goal_m: The goal as it is perceived, base axes [m].
        refused: Why tares were refused before the one that counts.
        late_ticks: Of those that go by the clock, how many began more than a millisecond late.
        lost: Rows that found no room, and rows and pictures that were never taken.
        problems: What went wrong with cameras.
        was_there: Whether it was recorded by an earlier run.
    """

    id: str
    samples: int
    outcome: Outcome
    who: str
    start_m: tuple[float, float, float]
    goal_m: tuple[float, float, float]
    refused: tuple[str, ...] = ()
    late_ticks: int = 0
    lost: int = 0
    problems: tuple[str, ...] = ()
    was_there: bool = False


def id_of(config: CollectConfig, index: int) -> str:
    """Name of a demonstration: two operators meet the same scenes, and may come to lie in one folder."""
    return episode_id(config.task, config.seed, index, config.operator)


def demonstration_of(episode: Episode, *, was_there: bool = False) -> Demonstration:
    """What a recording says of itself.

    Args:
        episode: With `tcp_pose` and `goal_pose`, its events and its closing record.
        was_there: Whether an earlier run recorded it.
    """
    pose, goal = episode["tcp_pose"], episode["goal_pose"]
    recorded: Mapping[str, Any] = episode.meta.get("recorded", {})
    x, y, z = (pose.data[0, :3] - goal.data[0, :3]).tolist()
    u, v, w = goal.data[0, :3].tolist()
    return Demonstration(
        id=episode.id,
        samples=len(pose),
        outcome=outcome_of(episode.meta["result"]),
        who=who_of(episode.meta),
        start_m=(x, y, z),
        goal_m=(u, v, w),
        refused=refused_of(episode.events),
        late_ticks=int(episode.meta["result"].get("late_ticks", 0)),
        lost=lost_of(recorded),
        problems=problems_of(recorded),
        was_there=was_there,
    )


def demonstration_in(path: Path) -> Demonstration:
    """What an earlier run recorded.

    Raises:
        RecordingError: If it cannot be read.
        StreamError: If it is no demonstration.
    """
    return demonstration_of(Recording(path).read(["tcp_pose", "goal_pose"]), was_there=True)


def outcome_of(result: Mapping[str, Any]) -> Outcome:
    """How it ended; of one whose process died, what is known."""
    usual = {"success": False, "duration_s": 0.0, "progress": 0.0, "failure": ""}
    return Outcome(**{field.name: result.get(field.name, usual[field.name]) for field in fields(Outcome)})


def who_of(meta: Mapping[str, Any]) -> str:
    """Who demonstrated: the operator's name, or the profile of an emulated one."""
    person = meta.get("person")
    return str(person["profile"]) if person else str(meta["operator"])


def refused_of(events: tuple[Event, ...]) -> tuple[str, ...]:
    """Why tares were refused."""
    return tuple(event.label.removeprefix("refused: ") for event in events if event.kind == TARE)


def lost_of(recorded: Mapping[str, Any]) -> int:
    """Rows and pictures that are not in a recording, by what the recorder says of its sources.

    A row that found no room leaves a number that is missing; only after the last row it does not.
    """
    return sum(max(of["dropped"], of.get("missing", 0)) for of in recorded.values())


def problems_of(recorded: Mapping[str, Any]) -> tuple[str, ...]:
    """What went wrong with cameras, each thing once."""
    return tuple(dict.fromkeys(of["problem"] for of in recorded.values() if "problem" in of))
