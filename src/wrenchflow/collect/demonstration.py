"""What became of a recorded attempt, in figures."""

from dataclasses import dataclass

from wrenchflow.sim.attempt import Outcome


@dataclass(frozen=True, kw_only=True)
class Demonstration:
    """What became of one recorded attempt.

    Attributes:
        id: Of the episode.
        samples: At 1 kHz.
        outcome: Done or not.
        late_ticks: Of those that go by the clock, how many began more than a millisecond late.
        lost: Rows that found no room, and rows and pictures that were never taken.
        problems: What went wrong with cameras.
    """

    id: str
    samples: int
    outcome: Outcome
    late_ticks: int = 0
    lost: int = 0
    problems: tuple[str, ...] = ()
