"""What is wrong with episodes of a data set, or worth a look before they are learned from."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from wrenchflow.datasets.analysis.figures import EpisodeFigures


@dataclass(frozen=True, kw_only=True)
class Kind:
    """Something that may be found.

    Attributes:
        name: Its name.
        figure: The figure that shows it.
        is_found: Whether a value of that figure does, of an episode.
        meaning: What it does to a policy that learns from it.
        is_defect: Whether it decides against the episode, or is only told.
    """

    name: str
    figure: str
    is_found: Callable[[float | int, EpisodeFigures], bool]
    meaning: str
    is_defect: bool = True


@dataclass(frozen=True, kw_only=True)
class Finding:
    """A kind, and the episodes that have it.

    Attributes:
        kind: What was found.
        episodes: Numbers of the episodes, those with the most of it first.
    """

    kind: Kind
    episodes: tuple[int, ...]


def _above(limit: float) -> Callable[[float | int, EpisodeFigures], bool]:
    return lambda value, _: value > limit


KINDS = (
    Kind(
        name="not-finite",
        figure="not_finite",
        is_found=_above(0.0),
        meaning="Numbers that are no numbers: one of them turns every weight of a network into none.",
    ),
    Kind(
        name="stamps-not-increasing",
        figure="repeated_stamps",
        is_found=_above(0.0),
        meaning="Stamps that repeat or go back: what belongs together cannot be told.",
    ),
    Kind(
        name="late-steps",
        figure="late_steps",
        is_found=lambda value, episode: value > 0.02 * (episode.values.get("steps") or 0),
        meaning="More than 2 % of the steps came late: speeds that are learned would be too high there.",
    ),
    Kind(
        name="skipped-actions",
        figure="skipped_actions",
        is_found=_above(0.0),
        meaning="Actions that were recorded and never carried out; leave these steps out.",
        is_defect=False,
    ),
    Kind(
        name="failed-commands",
        figure="failed_commands",
        is_found=_above(0.0),
        meaning="Commands that the controller refused: the arm did not do what the action says.",
    ),
    Kind(
        name="camera-skew",
        figure="camera_skew_ms",
        is_found=_above(50.0),
        meaning="Pictures of one step that were taken more than 50 ms apart.",
        is_defect=False,
    ),
    Kind(
        name="camera-age",
        figure="camera_age_ms",
        is_found=_above(100.0),
        meaning="Pictures more than 100 ms older than the robot's state beside them.",
        is_defect=False,
    ),
    Kind(
        name="controller-latency",
        figure="controller_latency_ms",
        is_found=_above(20.0),
        meaning="A controller that was more than 20 ms late in one step of twenty.",
        is_defect=False,
    ),
    Kind(
        name="clock-drift",
        figure="clock_drift_ms",
        is_found=_above(50.0),
        meaning="The robot's clock and the computer's came more than 50 ms apart: do not mix their stamps.",
        is_defect=False,
    ),
    Kind(
        name="short",
        figure="duration_s",
        is_found=lambda value, _: value < 1.0,
        meaning="Less than a second: hardly a demonstration.",
    ),
    Kind(
        name="no-contact",
        figure="contact_rate",
        is_found=lambda value, _: value == 0.0,
        meaning="A measured force that never shows a contact.",
        is_defect=False,
    ),
    Kind(
        name="idle",
        figure="idle_share",
        is_found=_above(0.5),
        meaning="For more than half of its steps nothing new was commanded: a policy may learn to wait.",
        is_defect=False,
    ),
)


def find(episodes: Sequence[EpisodeFigures]) -> tuple[Finding, ...]:
    """What was found, defects first."""
    found = []
    for kind in sorted(KINDS, key=lambda kind: not kind.is_defect):
        valued = [(episode.values.get(kind.figure), i) for i, episode in enumerate(episodes)]
        having = [(value, i) for value, i in valued if value is not None and kind.is_found(value, episodes[i])]
        if having:
            found.append(Finding(kind=kind, episodes=tuple(i for _, i in sorted(having, key=lambda one: -one[0]))))
    return tuple(found)
