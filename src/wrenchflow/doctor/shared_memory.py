"""Shared memory: what a recording travels through from the control loop to its writer."""

import os
from pathlib import Path

from wrenchflow.doctor.check import Check, bytes_said, seconds_said
from wrenchflow.doctor.probe import ask

_LIMIT_S = 90.0  # The first time, its code is compiled.
_ENOUGH_BYTES = 64 * 2**20


def check_shared_memory(place: Path = Path("/dev/shm")) -> Check:
    """Send rows through rings to another process and back.

    Args:
        place: Where the system keeps shared memory.
    """
    figures: dict[str, int | float | str | None] = {}
    room = ""
    if place.is_dir():
        system = os.statvfs(place)
        figures["size_bytes"], figures["free_bytes"] = (
            system.f_blocks * system.f_frsize,
            system.f_bavail * system.f_frsize,
        )
        room = f"{bytes_said(figures['free_bytes'])} of {bytes_said(figures['size_bytes'])} free"
    answer = ask(["-m", "wrenchflow.doctor.ring_probe"], limit_s=_LIMIT_S)
    if answer.failure:
        return Check(
            name="shared memory",
            state="missing",
            found=", ".join(filter(None, [f"no round trip: {answer.failure}", room])),
            means="Nothing can be recorded while it happens.",
            todo=f"Make room in {place}: 64 MiB or more; in a container, --shm-size=256m.",
            essential=True,
            figures=figures,
        )
    figures |= {"rows": answer.figures["rows"], "push_s": answer.figures["push_s"]}
    is_small = bool(room) and system.f_bavail * system.f_frsize < _ENOUGH_BYTES
    return Check(
        name="shared memory",
        state="warning" if is_small else "ok",
        found=f"{answer.figures['rows']} rows there and back, {seconds_said(answer.figures['push_s'])} to store one"
        + (f", {room}" if room else ""),
        means="Enough for the control loop; cameras may find no room." if is_small else "",
        todo="Raise its size to 64 MiB or more; in a container, --shm-size=256m." if is_small else "",
        essential=True,
        figures=figures,
    )
