"""What every process that works for the one with the control loop does first."""

import signal


def leave_signals_to_parent() -> None:
    """Pass over what a terminal, `timeout` or a service manager sends to the whole group.

    The control process hears it too, brakes the arm, and then tells us when all is written. Who wants this process to
    end, and it alone, has SIGKILL.
    """
    for name in ("SIGINT", "SIGTERM", "SIGUSR1"):
        if number := getattr(signal, name, None):
            signal.signal(number, signal.SIG_IGN)
