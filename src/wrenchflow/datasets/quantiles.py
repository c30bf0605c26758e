"""Exact quantiles of columns that are too long to hold, by counting digits of their bits.

Numbers are mapped to integers of the same order. Each pass over the data counts, for every rank that is looked for, the
next twelve bits of the numbers that begin like the one that is sought; after at most three passes over single precision
the numbers at all ranks are known, in memory that does not depend on how many there are.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int64

from wrenchflow.compiled import kernel

_BITS = 12

# What is read again for every pass: rows by columns, float32 or of any integer type.
Blocks = Callable[[], Iterable[np.ndarray]]


@dataclass(frozen=True, eq=False)
class Ranks:
    """Where quantiles lie in sorted rows, and how they follow from the numbers there.

    Attributes:
        rows: Ranks that are needed, sorted. Shape (r,).
        below: Of each quantile, which of them is the next below. Shape (q,).
        above: And the next above. Shape (q,).
        weight: Of the one above. Shape (q,).
    """

    rows: Int64[np.ndarray, " r"]
    below: Int64[np.ndarray, " q"]
    above: Int64[np.ndarray, " q"]
    weight: Float[np.ndarray, " q"]

    @staticmethod
    @lru_cache(256)
    def of(count: int, fractions: tuple[float, ...]) -> "Ranks":
        """Those of quantiles of `count` rows."""
        position = np.asarray(fractions, np.float64) * (count - 1)
        below = np.floor(position).astype(np.int64)
        above = np.minimum(below + 1, count - 1)
        rows = np.unique(np.concatenate([below, above]))
        return Ranks(rows, np.searchsorted(rows, below), np.searchsorted(rows, above), position - below)

    def quantiles(self, numbers: np.ndarray) -> Float[np.ndarray, "q d"]:
        """Quantiles from the numbers at the ranks. Shape (r, d)."""
        # Stamps are too large for float64, but the differences between two of them are not.
        is_float = np.issubdtype(numbers.dtype, np.floating)
        offset = np.zeros(numbers.shape[1]) if is_float else numbers[0].astype(np.int64)
        apart = (numbers - offset).astype(np.float64)
        low, high = apart[self.below], apart[self.above]
        return low + self.weight[:, None] * (high - low) + offset


def quantiles_of(
    blocks: Blocks, lowest: np.ndarray, highest: np.ndarray, count: int, fractions: Sequence[float]
) -> Float[np.ndarray, "q d"]:
    """Quantiles by linear interpolation between the two nearest ranks, as `numpy.quantile` has them.

    Args:
        blocks: The data, in parts of shape (rows, d), the same at every call.
        lowest: Least number of each column. Shape (d,).
        highest: Greatest number of each column. Shape (d,).
        count: Rows in all, one at least.
        fractions: Which quantiles, from 0 to 1.
    """
    ranks = Ranks.of(count, tuple(fractions))
    return ranks.quantiles(_values(_numbers_at(blocks, _keys(lowest), _keys(highest), ranks.rows), lowest.dtype))


def _numbers_at(
    blocks: Blocks, lowest: Int64[np.ndarray, " d"], highest: Int64[np.ndarray, " d"], ranks: Int64[np.ndarray, " r"]
) -> Int64[np.ndarray, "r d"]:
    """The keys at ranks of each column, in the order of the ranks."""
    width = len(lowest)
    bits = int((highest - lowest).max()).bit_length()
    prefix = np.zeros((width, len(ranks)), np.int64)
    left = np.repeat(ranks[None, :], width, axis=0)
    while bits > 0:
        digit = min(_BITS, bits)
        counts = np.zeros((width, len(ranks), 1 << digit), np.int64)
        for block in blocks():
            is_float = np.issubdtype(block.dtype, np.floating)
            _count(_numbers(block), is_float, lowest, prefix, bits, bits - digit, (1 << digit) - 1, counts)
        # One that is sought twice was counted at its first place only.
        first = np.array([[np.searchsorted(row, one) for one in row] for row in prefix])
        upto = np.cumsum(np.take_along_axis(counts, first[:, :, None], axis=1), axis=2)
        chosen = (upto <= left[:, :, None]).sum(axis=2)
        before = np.where(
            chosen > 0, np.take_along_axis(upto, np.maximum(chosen - 1, 0)[:, :, None], axis=2)[:, :, 0], 0
        )
        left = left - before
        prefix = (prefix << digit) | chosen
        bits -= digit
    return (prefix + lowest[:, None]).T


@kernel
def _count(numbers, is_float, lowest, prefix, bits, shift, mask, counts):
    """Count the digit at `shift` of the keys that have one of the prefixes above `bits`; prefixes are sorted."""
    sought = prefix.shape[1]
    for i in range(numbers.shape[0]):
        for j in range(numbers.shape[1]):
            key = np.int64(numbers[i, j])
            if is_float and key < 0:
                key = -(key & 0x7FFFFFFF)
            key -= lowest[j]
            head = key >> bits
            k = 0
            while k < sought and prefix[j, k] < head:
                k += 1
            if k < sought and prefix[j, k] == head:
                counts[j, k, (key >> shift) & mask] += 1


def _numbers(values: np.ndarray) -> np.ndarray:
    """Integers that `_count` makes keys of: those that are, or the bits of floats."""
    if np.issubdtype(values.dtype, np.floating):
        return np.ascontiguousarray(values, np.float32).view(np.int32)
    return values.astype(np.int64)


def _keys(values: np.ndarray) -> Int64[np.ndarray, "*n"]:
    """Integers in the order of the numbers."""
    numbers = _numbers(values).astype(np.int64)
    is_float = np.issubdtype(values.dtype, np.floating)
    return np.where(numbers < 0, -(numbers & 0x7FFFFFFF), numbers) if is_float else numbers


def _values(keys: Int64[np.ndarray, "*n"], dtype: np.dtype) -> np.ndarray:
    if not np.issubdtype(dtype, np.floating):
        return keys
    bits = np.where(keys < 0, (-keys) | 0x80000000, keys).astype(np.uint32)
    return bits.view(np.float32)
