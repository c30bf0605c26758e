"""Time: one monotonic clock, mapped to the epoch once, and how far another clock is from it."""

import time
from dataclasses import dataclass

SECOND_NS = 1_000_000_000


@dataclass(frozen=True)
class Clock:
    """The machine's monotonic clock with the epoch's time at one moment; never steps, whatever is done to the date.

    All processes of a machine share the monotonic clock, so a clock may be handed to another process.

    Attributes:
        monotonic_ns: What the monotonic clock showed.
        epoch_ns: Time since 1970 at that moment [ns].
    """

    monotonic_ns: int
    epoch_ns: int

    @classmethod
    def start(cls) -> "Clock":
        """Map the monotonic clock to the epoch, now."""
        # Of some tries the quickest: between its two looks at the one clock, the other one was read.
        tries = []
        for _ in range(5):
            before, epoch, after = time.monotonic_ns(), time.time_ns(), time.monotonic_ns()
            tries.append((after - before, before + (after - before) // 2, epoch))
        _, monotonic, epoch = min(tries)
        return cls(monotonic, epoch)

    def now_ns(self) -> int:
        """Time since 1970 [ns]."""
        return self.at_ns(time.monotonic_ns())

    def at_ns(self, monotonic_ns: int) -> int:
        """Time since 1970 [ns] when the monotonic clock showed `monotonic_ns`."""
        return self.epoch_ns + monotonic_ns - self.monotonic_ns


class ClockOffset:
    """How far our clock is ahead of a device's, told from the device's stamps and when they came.

        offset = ClockOffset()
        row["clock_offset_ns"] = offset.see(device_ns, clock.now_ns())
        row["t_ns"] = device_ns + row["clock_offset_ns"]

    A message is late by the way it takes, never early; so the smallest difference of late is nearest to the truth. It
    is taken over one to two windows, which is how the estimate follows a clock that runs fast or slow.
    """

    def __init__(self, window_ns: int = 10 * SECOND_NS) -> None:
        """Start without knowing anything.

        Args:
            window_ns: How long the smallest difference is looked for [ns].
        """
        self._window_ns = window_ns
        self._start_ns: int | None = None
        self._last: int | None = None
        self._smallest = 0

    def see(self, device_ns: int, received_ns: int) -> int:
        """Take in a stamp of the device and when it came, and return the offset as it is known now [ns]."""
        difference = received_ns - device_ns
        if self._start_ns is None:
            self._start_ns, self._smallest = received_ns, difference
        elif received_ns - self._start_ns >= self._window_ns:
            self._start_ns, self._last, self._smallest = received_ns, self._smallest, difference
        self._smallest = min(self._smallest, difference)
        return self._smallest if self._last is None else min(self._smallest, self._last)
