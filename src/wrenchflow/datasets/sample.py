"""From an episode, each stream at its own rate, to steps on one grid: the only place that resamples."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
from jaxtyping import Bool, Float32, Int64

from wrenchflow.config import from_mapping
from wrenchflow.datasets.grid import DEFAULT_RATE_HZ, Grid
from wrenchflow.datasets.pictures import pictures_at, taken, topic_of
from wrenchflow.episode import Episode
from wrenchflow.errors import ConfigError, DatasetError
from wrenchflow.force_filter import FilterConfig
from wrenchflow.messages import Messages
from wrenchflow.observation import RULES, Steps, actions, observe
from wrenchflow.process.contact import runs_of
from wrenchflow.sampling import age_ns, crosses_gap

# A step lies where all of these have samples, and its action where they still have them. The goal is said on change.
SAMPLED = ("tcp_pose", "tcp_twist", "joint_states", "wrench", "target_pose")
STREAMS = (*SAMPLED, "goal_pose")
_REACH_NS = {
    name: max([rule.reach_ns for rule in RULES.values() if rule.stream == name], default=0) for name in SAMPLED
}
# Of a picture, in its camera's periods: one that is older was not the last that should have come.
_OLDEST_PICTURE = 1.5


@dataclass(frozen=True, kw_only=True, eq=False)
class _Looked:
    """The steps of an episode before anything is sampled: when they are, and which of them have what they need.

    Attributes:
        t: Stamps of the steps [ns]. Shape (T,).
        t_next: Stamps of the steps that follow [ns]. Shape (T,).
        valid: By stream. Shape (T,).
        skew_ns: By stream [ns]. Shape (T,).
        cameras: Pictures by camera.
    """

    t: Int64[np.ndarray, " T"]
    t_next: Int64[np.ndarray, " T"]
    valid: Mapping[str, Bool[np.ndarray, " T"]]
    skew_ns: Mapping[str, Int64[np.ndarray, " T"]]
    cameras: Mapping[str, Messages]


def topics_of(grid: Grid) -> tuple[str, ...]:
    """The topics of pictures that a grid needs."""
    return tuple(topic_of(camera) for camera in _cameras(grid))


def _cameras(grid: Grid) -> list[str]:
    return list(dict.fromkeys([*grid.cameras, *filter(None, [grid.camera])]))


def is_success(episode: Episode) -> bool:
    """Whether the recording says that the attempt succeeded; False where it says nothing."""
    result = episode.meta.get("result")
    return isinstance(result, Mapping) and result.get("success") is True


def operator_of(episode: Episode) -> str:
    """Who demonstrated: the person if there was one, or else what stood in for one; empty where nobody says so."""
    person, operator = episode.meta.get("person"), episode.meta.get("operator")
    profile = person.get("profile") if isinstance(person, Mapping) else None
    return str(profile or operator or "")


def filter_of(episode: Episode) -> FilterConfig:
    """What `process` says that it filtered the wrench with; the usual filter where it says nothing.

    Raises:
        DatasetError: If what it says is no filter.
    """
    said: Any = episode.meta
    for key in ("process", "config", "filter"):
        said = said.get(key, {}) if isinstance(said, Mapping) else {}
    try:
        return from_mapping(FilterConfig, said)
    except ConfigError as error:
        raise DatasetError(f"episode {episode.id} says nothing sensible of its filter: {error}") from error


def to_steps(episode: Episode, rate_hz: Fraction | int = DEFAULT_RATE_HZ) -> Steps:
    """Sample an episode at a fixed rate, and refuse a gap; `sample` says how."""
    (steps,) = sample(episode, Grid(rate_hz=Fraction(rate_hz), gaps="refuse"))
    return steps


def sample(episode: Episode, grid: Grid) -> tuple[Steps, ...]:
    """Sample an episode on a grid, with the rules of `wrenchflow.observation`.

    The first step is at the end of the `tare` phase, or where all streams have begun if that is later. The last one
    is such that its action, one step later, is not after the first `success` event or the end of a stream.

    Args:
        episode: A processed episode, with the streams that `observe` and `actions` take.
        grid: Where the steps lie, and what becomes of a gap.

    Returns:
        One, or, with gaps that split, one for each part that a gap leaves, called `<id>.0`, `<id>.1` and so on.

    Raises:
        DatasetError: If a stream is missing or not finite, no step fits, or a gap is to be refused.
    """
    missing = [name for name in STREAMS if name not in episode or not len(episode[name])]
    if missing:
        raise DatasetError(
            f"episode {episode.id} has no samples of {', '.join(missing)}. It has: "
            f"{', '.join(sorted(episode.streams))}. `wrenchflow process` adds wrench."
        )
    try:
        looked = _look(episode, grid)
        parts = _parts(looked, grid)
        if not parts:
            raise DatasetError(f"a gap lies at each of its {len(looked.t)} steps.")
        names = [episode.id] if len(parts) == 1 else [f"{episode.id}.{number}" for number in range(len(parts))]
        return tuple(_steps(episode, grid, looked, part, name) for part, name in zip(parts, names, strict=True))
    except DatasetError as error:
        raise DatasetError(f"episode {episode.id}: {error}") from error


def _look(episode: Episode, grid: Grid) -> _Looked:
    cameras = {name: taken(episode, name) for name in _cameras(grid)}
    stamps = [episode[name].t for name in SAMPLED] + [messages.t for messages in cameras.values()]
    tare = [event.stop_ns for event in episode.events_of("phase") if event.label == "tare"]
    start_ns = max(*tare, int(episode["goal_pose"].t[0]), *(int(t[0]) for t in stamps))
    success = [event.start_ns for event in episode.events_of("success")]
    # A picture is there until the next one comes.
    stop_ns = min(*success, *(int(episode[name].t[-1]) for name in SAMPLED))
    if grid.camera:
        t = cameras[grid.camera].t
        t = t[(t >= start_ns) & (t <= stop_ns)]
    else:
        t = grid.times(start_ns, stop_ns)
    if len(t) < 2:
        raise DatasetError(
            f"there are {(stop_ns - start_ns) * 1e-9:.3f} s from its start to its end, expected a step of "
            f"{grid.period_ns * 1e-9:g} s or more."
        )
    t, t_next = t[:-1], t[1:]
    valid = {name: ~crosses_gap(episode[name], t, _reach_ns(name, grid)) for name in SAMPLED}
    valid["target_pose"] = ~crosses_gap(episode["target_pose"], t_next, 0)
    skew_ns = {name: age_ns(episode[name].t, t) for name in SAMPLED}
    for camera, messages in cameras.items():
        skew_ns[topic_of(camera)] = age = age_ns(messages.t, t)
        valid[topic_of(camera)] = (
            age <= _OLDEST_PICTURE * np.median(np.diff(messages.t)) if len(messages) > 1 else age < 1
        )
    return _Looked(
        t=t,
        t_next=t_next,
        valid=valid,
        skew_ns=skew_ns,
        cameras={name: cameras[name] for name in grid.cameras},
    )


def _reach_ns(stream: str, grid: Grid) -> int:
    """How far back the observations of a stream look [ns]."""
    return max((RULES[name].reach_ns for name in grid.observations if RULES[name].stream == stream), default=0)


def _parts(looked: _Looked, grid: Grid) -> list[slice]:
    """The steps that make up one entry each: all of them, or those between gaps."""
    if grid.gaps != "split":
        return [slice(0, len(looked.t))]
    # Where a picture did not come, the action of the step before would lie further ahead than those of the others.
    follows = looked.t_next - looked.t <= _OLDEST_PICTURE * grid.period_ns
    usable = np.logical_and.reduce([follows, *looked.valid.values()])
    return [slice(first, last) for first, last in runs_of(usable, True)]


def _steps(episode: Episode, grid: Grid, looked: _Looked, part: slice, name: str) -> Steps:
    t = looked.t[part]
    valid = {stream: of[part] for stream, of in looked.valid.items()}
    everything = np.ones(len(t), bool)
    rows = valid if grid.gaps == "mark" else {}

    def observed(name: str) -> Float32[np.ndarray, "T ..."]:
        stream = RULES[name].stream
        return _held(rows.get(stream, everything), lambda some: observe(episode.streams, t[some], [name])[name])

    return Steps(
        episode_id=name,
        t=t,
        period_ns=grid.period_ns,
        observations={observation: observed(observation) for observation in grid.observations},
        actions=_held(
            rows.get("target_pose", everything),
            lambda some: actions(episode.streams, t[some], looked.t_next[part][some]),
        ),
        success=is_success(episode),
        wrench_filter=filter_of(episode),
        recording_id=episode.id,
        task=episode.task,
        operator=operator_of(episode),
        skew_ns={stream: of[part] for stream, of in looked.skew_ns.items()},
        valid=valid,
        pictures={camera: pictures_at(messages, t) for camera, messages in looked.cameras.items()},
    )


def _held(
    valid: Bool[np.ndarray, " T"], values_at: Callable[[Bool[np.ndarray, " T"]], Float32[np.ndarray, "v ..."]]
) -> Float32[np.ndarray, "T ..."]:
    """Values at the steps that have what they need, repeated at those after them; at the front, the first of them.

    Raises:
        DatasetError: If no step has what it needs.
    """
    if not valid.any():
        raise DatasetError(f"a gap lies at each of its {len(valid)} steps.")
    values = values_at(valid)
    return values if valid.all() else values[np.maximum(np.cumsum(valid) - 1, 0)]
