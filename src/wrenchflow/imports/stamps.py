"""Stamps of others: exact nanoseconds, and rows that are not later than those before them."""

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation

import numpy as np
from jaxtyping import Bool, Int64

from wrenchflow.errors import RecordingError
from wrenchflow.imports.mapping import TIME_UNITS_NS

_MOST_NS = 2**62


def to_ns(values: Sequence[object], unit: str, where: str) -> Int64[np.ndarray, " n"]:
    """Whole nanoseconds of stamps, without the rounding of a float where they come as text or as integers.

    Args:
        values: Text, or numbers.
        unit: s, ms, us or ns.
        where: Name of the column, for messages.

    Raises:
        RecordingError: If one is no finite number, or beyond what a clock shows.
    """
    scale, out = Decimal(TIME_UNITS_NS[unit]), np.empty(len(values), np.int64)
    for row, value in enumerate(values):
        try:
            stamp_ns = Decimal(str(value)) * scale
        except InvalidOperation as error:
            raise RecordingError(f"{where}: stamp {row + 1} is '{value}', expected a number.") from error
        if not stamp_ns.is_finite() or abs(stamp_ns) >= _MOST_NS:
            raise RecordingError(f"{where}: stamp {row + 1} is {value} {unit}, which no clock shows.")
        out[row] = int(stamp_ns.to_integral_value())
    return out


@dataclass(frozen=True, kw_only=True, eq=False)
class Order:
    """Which rows are later than all before them.

    Attributes:
        keep: Those. Shape (n,).
        repeated: Rows that have the latest stamp so far again.
        backward: Rows that have an earlier one.
        first: The first row that is not kept, from 1 on; 0 if all are.
    """

    keep: Bool[np.ndarray, " n"]
    repeated: int
    backward: int
    first: int

    def told(self, name: str) -> str:
        """In words, of a stream."""
        return (
            f"{self.repeated} stamps of '{name}' repeat the one before, and {self.backward} go back (the first in row "
            f"{self.first} of {len(self.keep)})"
        )


def order_of(t: Int64[np.ndarray, " n"]) -> Order:
    """Look for rows that are not later than all before them."""
    latest = np.maximum.accumulate(t) if len(t) else t
    keep = np.ones(len(t), bool)
    keep[1:] = t[1:] > latest[:-1]
    return Order(
        keep=keep,
        repeated=int((t[1:] == latest[:-1]).sum()),
        backward=int((t[1:] < latest[:-1]).sum()),
        first=0 if keep.all() else int(np.argmin(keep)) + 1,
    )
