"""Work that kills its worker; in a module of its own, so that a worker can import it."""

import os
import signal
import time
from pathlib import Path


def die_at_first(folder: Path, item: int) -> int:
    """Kill the worker on the first try of one item; where it is done again, nothing is wrong."""
    time.sleep(0.05)
    mark = folder / f"{item}"
    if item == 5 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    mark.touch()
    return item * item


def die_always(item: int) -> int:
    """Kill the worker each time."""
    os.kill(os.getpid(), signal.SIGKILL)
    return item
