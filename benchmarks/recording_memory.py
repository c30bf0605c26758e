"""Whether memory stays flat over a long recording: of the control process, of the writer and of the camera.

uv run python benchmarks/recording_memory.py [MINUTES]

All low-dimensional topics at 1 kHz and two cameras, as in `recording_call.py`; resident memory of each process once a
second.
"""

import multiprocessing
import os
import sys
import tempfile
import threading
from pathlib import Path

import numpy as np

from recording_call import run

_PAGE = os.sysconf("SC_PAGE_SIZE")


def resident_mb(pid: int) -> float:
    """Memory of a process that is its own, without what it shares with others, such as the rings [MB]."""
    total, shared = map(int, Path(f"/proc/{pid}/statm").read_text().split()[1:3])
    return (total - shared) * _PAGE / 1e6


def watch(rows: list[dict[str, float]], over: threading.Event) -> None:
    """Note the memory of all processes once a second."""
    while not over.wait(1.0):
        pids = {child.name: child.pid for child in multiprocessing.active_children()}
        rows.append({name: resident_mb(pid) for name, pid in {"control": os.getpid(), **pids}.items() if pid})


def main(minutes: float) -> None:
    """Record, and print each process's memory at the start, in the middle and at the end."""
    rows: list[dict[str, float]] = []
    over = threading.Event()
    watching = threading.Thread(target=watch, args=(rows, over))
    watching.start()
    with tempfile.TemporaryDirectory() as folder:
        result = run(Path(folder), minutes * 60.0)
    over.set()
    watching.join()
    print(f"{minutes:g} min, rows lost {result.rows_missing}")
    for name in rows[len(rows) // 2]:
        of = np.array([row[name] for row in rows if name in row])
        tenth = max(len(of) // 10, 1)
        # What starts up and what winds down is left out.
        start, middle, end = (np.median(part) for part in np.array_split(of[tenth:-tenth], 3))
        slope = np.polyfit(np.arange(len(of))[tenth:-tenth] / 60.0, of[tenth:-tenth], 1)[0]
        print(f"{name:18} {start:6.1f} {middle:6.1f} {end:6.1f} MB in thirds of the time; {slope:+.3f} MB a minute")


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 10.0)
