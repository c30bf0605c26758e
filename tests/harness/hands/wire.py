"""The wire of a SpaceMouse: report bytes, as hidapi hands them over."""

from collections import deque

import numpy as np

from wrenchflow.collect.devices.hid_report import encode_buttons, encode_motion, encode_split


class Wire:
    """A transport of reports that a test puts on it.

    Attributes:
        reads: How often it was asked.
        never_dry: Whether its last report comes again and again, as of a driver that repeats itself.
    """

    def __init__(self, *reports: bytes) -> None:
        self.reads, self.never_dry, self.is_closed = 0, False, False
        self._reports: deque[bytes] = deque(reports)
        self._error: Exception | None = None

    def put(self, report: bytes) -> None:
        self._reports.append(report)

    def unplug(self) -> None:
        self._error = OSError("read error")

    def read(self, length: int, /) -> list[int]:
        self.reads += 1
        if self._error is not None:
            raise self._error
        if not self._reports:
            return []
        report = self._reports[0] if self.never_dry and len(self._reports) == 1 else self._reports.popleft()
        return list(report[:length])

    def close(self) -> None:
        assert not self.is_closed, "closed twice"
        self.is_closed = True


def whole(*counts: int) -> bytes:
    """One report of six axes."""
    report = np.zeros(13, np.uint8)
    encode_motion(np.array(counts, np.int64), report)
    return report.tobytes()


def split(*counts: int) -> tuple[bytes, bytes]:
    """The two reports of an older wired device."""
    first, second = np.zeros(7, np.uint8), np.zeros(7, np.uint8)
    encode_split(np.array(counts, np.int64), first, second)
    return first.tobytes(), second.tobytes()


def pressed(buttons: int, length: int = 3) -> bytes:
    """A report of buttons."""
    report = np.zeros(length, np.uint8)
    encode_buttons(buttons, report)
    return report.tobytes()
