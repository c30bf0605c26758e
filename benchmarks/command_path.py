"""From the bytes of a SpaceMouse's report to a changed torque: how long at worst, in ticks and by the clock.

Virtual time: bytes come in every tick of a period, in both forms of report, for every direction; two runs that differ
in nothing else are compared to the bit. Real time: another process sends one report at any moment over a socket, and
the clock is read again when the first tick with another torque is over.
"""

import argparse
import os
import socket
import sys
import time
from itertools import product
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
from tqdm import tqdm

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "harness"))

from operators.command_path import (
    BOUND_TICKS,
    FORMS,
    PERIOD_TICKS,
    VIRTUAL_PERIODS,
    Watched,
    first_difference,
    pushes,
    reports_of,
    ticks_to_torque,
    undisturbed,
)
from wrenchflow.collect.devices.emulated_spacemouse import FULL_SCALE_COUNTS
from wrenchflow.collect.devices.spacemouse import SpaceMouse
from wrenchflow.spacemouse_models import SpaceMouseModel

TICK_NS, SPIN_NS = 1_000_000, 150_000
PERIODS = 80  # Of a run in real time.


def in_virtual_time() -> np.ndarray:
    """Ticks from bytes to torque. Shape (pushes, forms, phases)."""
    calm = undisturbed(VIRTUAL_PERIODS)
    cases = list(product(pushes(), FORMS, range(PERIOD_TICKS)))
    ticks = [ticks_to_torque(counts, form, phase, calm) for counts, form, phase in tqdm(cases, disable=None)]
    return np.array(ticks).reshape(len(pushes()), len(FORMS), PERIOD_TICKS)


class SocketWire:
    """Reports over a socket that keeps them apart, read as `hidapi` reads a device."""

    def __init__(self, end: socket.socket) -> None:
        """Take its end."""
        self._end = end
        end.setblocking(False)

    def read(self, length: int, /) -> bytes:
        """The next one, or nothing."""
        try:
            return self._end.recv(length)
        except BlockingIOError:
            return b""

    def close(self) -> None:
        """Let go."""
        self._end.close()


def push_when_told(end: socket.socket, told: Connection) -> None:
    """Send a report so many seconds after being told to, and say when it was; None ends it."""
    (report,) = reports_of((FULL_SCALE_COUNTS, 0, 0, 0, 0, 0), "whole")
    told.send(time.monotonic_ns())  # It is there; a process takes seconds to begin.
    while (wait_s := told.recv()) is not None:
        time.sleep(wait_s)
        now_ns = time.monotonic_ns()
        end.send(report)
        told.send(now_ns)


def in_real_time(trials: int) -> tuple[np.ndarray, np.ndarray]:
    """Times from bytes to torque [ms], and by how much the worst tick of each trial was late [ms]. Shape (trials,)."""
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    context = get_context("spawn")
    told, tell = context.Pipe()
    process = context.Process(target=push_when_told, args=(theirs, told), daemon=True)
    process.start()
    tell.recv()
    model = SpaceMouseModel(name="SpaceMouse at a socket", full_scale_counts=FULL_SCALE_COUNTS)
    calm, rng = undisturbed(PERIODS), np.random.default_rng(0)
    took, late = [], []
    for _ in tqdm(range(trials), disable=None):
        over_ns: dict[int, int] = {}

        def after_tick(tick: int, over_ns: dict[int, int] = over_ns) -> None:
            over_ns[tick] = time.monotonic_ns()
            until_ns = over_ns[min(over_ns)] + (tick + 1) * TICK_NS
            left_ns = until_ns - time.monotonic_ns()
            if left_ns > SPIN_NS:
                time.sleep((left_ns - SPIN_NS) * 1e-9)
            while time.monotonic_ns() < until_ns:
                pass

        watched = Watched(SpaceMouse(SocketWire(ours.dup()), model), after_tick)
        tell.send(float(rng.uniform(0.05, 0.25)))
        torque = watched.run(PERIODS)
        first = first_difference(torque, calm)
        took.append((over_ns[first] - tell.recv()) * 1e-6)
        ticks = np.array([over_ns[tick] for tick in sorted(over_ns)])[watched.start :]
        late.append((np.diff(ticks).max() - TICK_NS) * 1e-6)
    tell.send(None)
    process.join()
    return np.array(took), np.array(late)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=100, help="in real time, half a second each")
    arguments = parser.parse_args()
    ticks = in_virtual_time()
    print(f"virtual time, {ticks.size} cases: ticks from the tick in which bytes came to the first other torque")
    for number, form in enumerate(FORMS):
        by_phase = ", ".join(f"{t}" for t in ticks[:, number].max(0))
        print(
            f"  {form:6} at most {ticks[:, number].max()} (bytes in tick 1 to {PERIOD_TICKS} of a period: {by_phase})"
        )
    print(f"  goal: at most {BOUND_TICKS}, one period and a tick")
    took, late = in_real_time(arguments.trials)
    print(f"\nreal time, {arguments.trials} reports: from bytes sent to the end of the first tick with another torque")
    print(f"  median {np.median(took):.2f} ms, p99 {np.percentile(took, 99):.2f} ms, max {took.max():.2f} ms")
    print(f"  in {np.mean(took <= BOUND_TICKS):.0%} within {BOUND_TICKS} ms")
    print(f"  on {os.cpu_count()} threads at a load of {os.getloadavg()[0]:.1f};")
    print(f"  ticks were late by up to {np.median(late):.2f} ms in the median trial, {late.max():.2f} ms in the worst")
    return 0 if ticks.max() <= BOUND_TICKS else 1


if __name__ == "__main__":
    sys.exit(main())
