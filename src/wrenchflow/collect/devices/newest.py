"""The newest of what a driver gives that waits itself: it is asked in a thread of its own, so that no other waits."""

import threading
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

_PAUSE_S = 0.004  # Between two questions: twice as often as the fastest drivers have news.


class News(NamedTuple):
    """What the driver gave last.

    Attributes:
        number: Of the answers so far, sound or not.
        values: The newest answer that was one, by name.
        error: Why the newest was none; None where it was.
        failures: How many in a row were none.
    """

    number: int
    values: Mapping[str, Any]
    error: Exception | None
    failures: int


class Newest:
    """Asks a driver in a thread.

    Attributes:
        news: What it gave last; replaced whole, so that it can be read at any time.
    """

    def __init__(self, ask: Callable[[], Mapping[str, Any]]) -> None:
        """Begin to ask."""
        self.news = News(0, {}, None, 0)
        self._ask, self._stop = ask, threading.Event()
        self._thread = threading.Thread(target=self._run, name="teleoperator", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop asking; a driver that never answers is left behind."""
        self._stop.set()
        self._thread.join(timeout=1.0)

    def _run(self) -> None:
        while not self._stop.is_set():
            last = self.news
            try:
                self.news = News(last.number + 1, dict(self._ask()), None, 0)
            except Exception as error:  # Every driver has errors of its own.
                self.news = News(last.number + 1, last.values, error, last.failures + 1)
            self._stop.wait(_PAUSE_S)
