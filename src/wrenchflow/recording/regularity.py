"""How regularly the rows of a source come, told while they come."""

from typing import Any

import numpy as np

from wrenchflow.source import SEQUENCE, T


class Regularity:
    """How regularly a source's rows come: gaps against the median of its first hundred periods, numbers that are missing
    where the source counts its rows, and jitter.
    """

    def __init__(self) -> None:
        self.start_ns = 0
        self._rows = self._gaps = 0
        self._last_ns: int | None = None
        self._first: list[int] = []
        self._sum = self._squares = 0.0
        self._longest_ns = self._missing = 0
        self._number: int | None = None

    def see(self, rows: np.ndarray) -> None:
        """Take in some rows, which follow those before."""
        t = rows[T]
        if SEQUENCE in (rows.dtype.names or ()):
            numbers = rows[SEQUENCE] if self._number is None else np.concatenate(([self._number], rows[SEQUENCE]))
            self._missing += int((np.diff(numbers) - 1).clip(min=0).sum())
            self._number = int(numbers[-1])
        if self._last_ns is None:
            self.start_ns = int(t[0])
        stamps = t if self._last_ns is None else np.concatenate(([self._last_ns], t))
        between = np.diff(stamps)
        self._first += between[: 100 - len(self._first)].tolist()
        is_gap = between > 1.5 * np.median(self._first) if self._first else np.zeros(0, bool)
        regular = between[~is_gap].astype(float)
        self._gaps += int(is_gap.sum())
        self._sum += regular.sum()
        self._squares += (regular**2).sum()
        self._longest_ns = max(self._longest_ns, int(between.max(initial=0)))
        self._rows += len(t)
        self._last_ns = int(t[-1])

    def said(self) -> dict[str, Any]:
        """Plain figures."""
        n = max(self._rows - 1 - self._gaps, 1)
        mean = self._sum / n
        return {
            "rows": self._rows,
            "missing": self._missing,
            "gaps": self._gaps,
            "longest_s": self._longest_ns * 1e-9,
            "jitter_s": max(self._squares / n - mean**2, 0.0) ** 0.5 * 1e-9,
        }
