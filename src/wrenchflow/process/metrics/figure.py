"""What a metric comes to, or why it does not come to anything."""

import math
from collections.abc import Iterable, Iterator

import numpy as np
from jaxtyping import Bool

from wrenchflow.process.finding import NotAssessed
from wrenchflow.process.metric import Value

type Figure = tuple[str, Value] | NotAssessed

# The filter smears an impact over some 50 ms: what lies that near to a contact is neither free motion nor contact.
GUARD_NS = 50_000_000
MIN_SAMPLES = 100


def unknown_all(names: Iterable[str], reason: str) -> Iterator[Figure]:
    """None of these could be told."""
    for name in names:
        yield NotAssessed(kind=name, reason=reason)


def is_finite(value: Value) -> bool:
    """Whether it is a number that JSON can hold."""
    return value is not None and math.isfinite(value)


def too_few(**flags: Bool[np.ndarray, " n"]) -> str:
    """Why a part of the samples does not do, by its name with `_` for a space; empty if each of them does."""
    for name, each in flags.items():
        if (count := int(each.sum())) < MIN_SAMPLES:
            return f"{count} samples of {name.replace('_', ' ')}, {MIN_SAMPLES} needed"
    return ""
