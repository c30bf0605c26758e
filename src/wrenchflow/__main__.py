"""The door: `wrenchflow` and `python -m wrenchflow`."""

import os
import signal
import sys
from typing import Any

from wrenchflow.errors import Terminated


def main() -> int:
    """Load the command line and run it; Ctrl-C is answered in one line even while it loads."""
    sys.unraisablehook = _hear_again
    signal.signal(signal.SIGTERM, _terminate)
    try:
        from wrenchflow.cli import main as command_line

        code = command_line()
        sys.stdout.flush()  # Here and not at exit, where a reader that has gone cannot be answered any more.
        return code
    except KeyboardInterrupt as end:
        is_asked = isinstance(end, Terminated)
        sys.stderr.write(f"wrenchflow: {'terminated' if is_asked else 'interrupted'}.\n")
        return 143 if is_asked else 130
    except BrokenPipeError:  # Whoever read our output, `head` for one, has seen enough; the rest goes nowhere.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 141


def _terminate(*_: Any) -> None:
    """Answer who asks us to end as Ctrl-C is answered: workers are ended, and black boxes written."""
    raise Terminated


def _hear_again(what: Any) -> None:
    """Let a Ctrl-C that fell into a callback, where Python drops what is raised, be heard a moment later."""
    if issubclass(what.exc_type, KeyboardInterrupt) and hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, signal.default_int_handler)
        signal.setitimer(signal.ITIMER_REAL, 0.01)
    else:
        sys.__unraisablehook__(what)


if __name__ == "__main__":  # Spawned workers import this module again, and must not run it.
    sys.exit(main())
