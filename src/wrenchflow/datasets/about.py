"""What is known of a whole data set, and goes along with it in every format."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

from wrenchflow.config import from_mapping, to_mapping
from wrenchflow.datasets.config import ExportConfig
from wrenchflow.datasets.grid import rate_of
from wrenchflow.datasets.keys import KEYS, SKEW_RULE, VALID_RULE, Key, keys_of
from wrenchflow.errors import ConfigError, DatasetError
from wrenchflow.force_filter import FilterConfig
from wrenchflow.observation import OBSERVATIONS, OPTIONAL, Steps


@dataclass(frozen=True, kw_only=True)
class About:
    """What is known before the first episode.

    Attributes:
        config: How it is made.
        wrench_stage: What was done to the wrench.
        wrench_group_delay_s: How far the causal filter makes the wrench lag behind slow changes [s].
        masks: Recordings by the name of a mask that is wanted beside those by split, task and operator.
        splits: `train`, `valid` or `test` by recording, where somebody divided them; else they are by their ids.
    """

    config: ExportConfig = field(default_factory=ExportConfig)
    wrench_stage: str = "tared, gravity-compensated, causally filtered"
    wrench_group_delay_s: float | None = None
    masks: Mapping[str, Collection[str]] = field(default_factory=dict)
    splits: Mapping[str, str] = field(default_factory=dict)

    def described(self, first: Steps) -> dict[str, Any]:
        """What every format says of the whole, as plain values.

        Args:
            first: An episode of it; all have its rate, its filter and its streams.
        """
        rate_hz = rate_of(first.period_ns)
        return {
            "period_ns": first.period_ns,
            "rate_hz": f"{rate_hz.numerator}/{rate_hz.denominator}",
            "grid": self.config.grid,
            "gaps": self.config.gaps,
            "wrench_stage": self.wrench_stage,
            "wrench_group_delay_s": self.wrench_group_delay_s,
            "wrench_filter": to_mapping(first.wrench_filter),
            "observations": {key.name: key.described(self.wrench_group_delay_s) for key in keys_of(first.observations)},
            "sync": {"streams": list(first.skew_ns), "skew_rule": SKEW_RULE, "valid_rule": VALID_RULE},
        }


def keys_said(described: Mapping[str, Any], where: str) -> tuple[Key, ...]:
    """The keys that a data set says it has.

    Raises:
        DatasetError: If there is one that is not known.
    """
    there = set(described.get("observations", ()))
    found = tuple(key for key in KEYS if key.name in there)
    if len(found) != len(there) or not set(OBSERVATIONS) - OPTIONAL <= {key.observation for key in found}:
        raise DatasetError(
            f"{where} says that it has {', '.join(sorted(there)) or 'no observations'}, expected "
            f"{', '.join(key.name for key in KEYS)}."
        )
    return found


def filter_said(described: Mapping[str, Any], where: str) -> FilterConfig:
    """The wrench's filter that a data set says it has.

    Raises:
        DatasetError: If what it says is no filter.
    """
    try:
        return from_mapping(FilterConfig, described.get("wrench_filter", {}), "wrench_filter")
    except ConfigError as error:
        raise DatasetError(f"{where}: 'wrench_filter' describes no filter: {error}") from error
