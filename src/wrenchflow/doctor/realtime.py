"""How punctual this machine is, and what it lets us do about it."""

import resource
import time

import numpy as np

from wrenchflow.doctor.check import Check, bytes_said, seconds_said
from wrenchflow.doctor.probe import ask

_SLEEP_S = 1e-3
_SLEEPS = 900  # About a second of them.
_LATE_S = 1e-3  # A sleep that ends this late has missed the tick after.
_LOCKED_BYTES = 64 * 2**20

# Asked for by a process that ends right after, so that nobody keeps it.
_TRY_FIFO = """
import json, os
priority = os.sched_get_priority_max(os.SCHED_FIFO) - 19
os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
print(json.dumps({"priority": priority}))
"""


def check_timer() -> Check:
    """How late sleeps of a millisecond end."""
    late = np.empty(_SLEEPS)
    for number in range(_SLEEPS):
        start_s = time.perf_counter()
        time.sleep(_SLEEP_S)
        late[number] = time.perf_counter() - start_s - _SLEEP_S
    p50, p999, worst = (float(value) for value in np.percentile(late, [50.0, 99.9, 100.0]))
    is_punctual = p999 < _LATE_S
    return Check(
        name="timer",
        state="ok" if is_punctual else "warning",
        found=f"a sleep of 1 ms ends {seconds_said(p50)} late (p50), {seconds_said(p999)} (p99.9), "
        f"{seconds_said(worst)} (max)",
        means=""
        if is_punctual
        else "At 1 kHz some ticks begin more than a tick late; `collect --realtime` counts them.",
        todo="" if is_punctual else "Close other programs; for a real arm, a kernel with PREEMPT_RT and SCHED_FIFO.",
        figures={"late_p50_s": p50, "late_p999_s": p999, "late_max_s": worst},
    )


def check_scheduling() -> Check:
    """Whether we may run before everybody else (SCHED_FIFO)."""
    answer = ask(["-c", _TRY_FIFO], limit_s=10.0)
    if answer.failure:
        return Check(
            name="SCHED_FIFO",
            state="warning",
            found=f"not allowed: {answer.failure}",
            means="The control loop of a real arm cannot be put before other programs; simulation does not need it.",
            todo="Add '@realtime - rtprio 99' to /etc/security/limits.d/realtime.conf and yourself to that group; "
            "in a container, --cap-add SYS_NICE --ulimit rtprio=99.",
        )
    priority = answer.figures["priority"]
    return Check(name="SCHED_FIFO", state="ok", found=f"allowed, priority {priority}", figures={"priority": priority})


def check_memory_lock() -> Check:
    """How much memory may be kept from being paged out."""
    limit, _ = resource.getrlimit(resource.RLIMIT_MEMLOCK)
    is_enough = limit == resource.RLIM_INFINITY or limit >= _LOCKED_BYTES
    return Check(
        name="memory lock",
        state="ok" if is_enough else "warning",
        found="no limit" if limit == resource.RLIM_INFINITY else f"at most {bytes_said(limit)}",
        means=""
        if is_enough
        else "A real-time process cannot lock its memory; a page that was put out makes a late tick.",
        todo=""
        if is_enough
        else "Add '@realtime - memlock unlimited' to /etc/security/limits.d/realtime.conf; in a "
        "container, --ulimit memlock=-1.",
        figures={"limit_bytes": None if limit == resource.RLIM_INFINITY else limit},
    )
