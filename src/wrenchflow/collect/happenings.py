"""What happens besides in an attempt: moments that a person marked, and stretches in which the arm did not follow."""

from collections.abc import Iterator

from wrenchflow.episode import Event

DEVICE, MARK = "device", "mark"  # Kinds of events.


class Happenings:
    """Sees every period, and says what came of them."""

    def __init__(self) -> None:
        """Nothing has happened."""
        self._events: list[Event] = []
        self._marked_ns: int | None = None
        self._problem, self._since_ns = "", 0

    def see(self, t_ns: int, *, is_marked: bool, problem: str) -> float:
        """Take in a period.

        Args:
            t_ns: When it began.
            is_marked: Whether the button is pressed.
            problem: Why the arm does not follow its device; empty if it does.

        Returns:
            For how long it has not been followed, whatever for [s].
        """
        if is_marked and self._marked_ns is None:
            self._marked_ns = t_ns
        elif not is_marked and self._marked_ns is not None:
            self._events.append(Event(self._marked_ns, t_ns, MARK))
            self._marked_ns = None
        if problem != self._problem:
            if self._problem:
                self._events.append(Event(self._since_ns, t_ns, DEVICE, self._problem))
            self._problem, self._since_ns = problem, t_ns
        return (t_ns - self._since_ns) * 1e-9 if problem else 0.0

    def events(self, end_ns: int) -> Iterator[Event]:
        """All that happened, what still goes on up to `end_ns`."""
        yield from self._events
        if self._marked_ns is not None:
            yield Event(self._marked_ns, max(end_ns, self._marked_ns), MARK)
        if self._problem:
            yield Event(self._since_ns, max(end_ns, self._since_ns), DEVICE, self._problem)
