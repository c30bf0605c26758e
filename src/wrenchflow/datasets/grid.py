"""From an episode, each stream at its own rate, to steps on the policy's grid: the only place that resamples."""

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from wrenchflow.config import from_mapping
from wrenchflow.episode import Episode
from wrenchflow.errors import ConfigError, DatasetError
from wrenchflow.force_filter import FilterConfig
from wrenchflow.observation import Steps, actions, observe

DEFAULT_RATE_HZ = Fraction(20)

# A step lies where all of these have samples, and its action where they still have them. The goal is said on change.
_SAMPLED = ("tcp_pose", "tcp_twist", "joint_states", "wrench", "target_pose")
STREAMS = (*_SAMPLED, "goal_pose")


def period_of(rate_hz: Fraction | int) -> int:
    """Time between steps [ns], rounded: a rate such as 30 Hz, of no whole period, drifts by 10 ns a second.

    Raises:
        ConfigError: If the rate is not between 0 and 1 kHz.
    """
    if not 0 < rate_hz <= 1000:
        raise ConfigError(f"a policy runs at more than 0 and at most 1000 Hz, got {float(rate_hz):g} Hz.")
    return round(1_000_000_000 / Fraction(rate_hz))


def rate_of(period_ns: int) -> Fraction:
    """The rate [Hz] that a period stands for: 33333333 ns is 30 Hz, 33366667 ns is 30000/1001 Hz."""
    return Fraction(1_000_000_000, period_ns).limit_denominator(1001)


def is_success(episode: Episode) -> bool:
    """Whether the recording says that the attempt succeeded; False where it says nothing."""
    result = episode.meta.get("result")
    return isinstance(result, Mapping) and result.get("success") is True


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
    """Sample an episode at a fixed rate, with the rules of `wrenchflow.observation`.

    The first step is at the end of the `tare` phase, or where all streams have begun if that is later. The last one
    is such that its action, one period later, is not after the first `success` event or the end of a stream.

    Args:
        episode: A processed episode, with the streams that `observe` and `actions` take.
        rate_hz: Steps a second.

    Raises:
        DatasetError: If a stream is missing, has a gap or is not finite there, or no step fits.
    """
    period_ns = period_of(rate_hz)
    missing = [name for name in STREAMS if name not in episode or not len(episode[name])]
    if missing:
        raise DatasetError(
            f"episode {episode.id} has no samples of {', '.join(missing)}. It has: "
            f"{', '.join(sorted(episode.streams))}. `wrenchflow process` adds wrench."
        )
    tare = [event.stop_ns for event in episode.events_of("phase") if event.label == "tare"]
    start_ns = max(*tare, int(episode["goal_pose"].t[0]), *(int(episode[name].t[0]) for name in _SAMPLED))
    success = [event.start_ns for event in episode.events_of("success")]
    stop_ns = min(*success, *(int(episode[name].t[-1]) for name in _SAMPLED))
    count = (stop_ns - start_ns) // period_ns
    if count < 1:
        raise DatasetError(
            f"episode {episode.id} has {(stop_ns - start_ns) * 1e-9:.3f} s from its start to its end, expected a step "
            f"of {period_ns * 1e-9:g} s or more."
        )
    t = start_ns + np.arange(count, dtype=np.int64) * period_ns
    try:
        return Steps(
            episode_id=episode.id,
            t=t,
            period_ns=period_ns,
            observations=observe(episode.streams, t),
            actions=actions(episode.streams, t, period_ns),
            success=is_success(episode),
            wrench_filter=filter_of(episode),
        )
    except DatasetError as error:
        raise DatasetError(f"episode {episode.id}: {error}") from error
