"""From the bytes of a report to a changed torque: two runs that differ in nothing but the bytes, tick by tick."""

from collections.abc import Callable, Sequence
from itertools import product

import numpy as np

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.devices.device import TeleopDevice
from wrenchflow.collect.devices.emulated_spacemouse import FULL_SCALE_COUNTS, EmulatedSpaceMouse
from wrenchflow.collect.devices.hid_report import encode_motion, encode_split
from wrenchflow.collect.session import Session
from wrenchflow.sim.attempt import DEMONSTRATE, Attempt
from wrenchflow.sim.tasks import scenery

CONFIG = CollectConfig(operator="emulated", tare_s=0.4)
PERIOD_TICKS = round(1000 / CONFIG.device_hz)
# The goal: what a report may have to wait for the next period, and the tick that acts on it.
BOUND_TICKS = PERIOD_TICKS + 1
_REST_PERIODS = 20  # With somebody at the device who rests.
FORMS = ("whole", "split")


def reports_of(counts: Sequence[int], form: str) -> list[bytes]:
    """The bytes that say these counts, in one of `FORMS`."""
    axes = np.array(counts, np.int64)
    if form == "whole":
        whole = np.zeros(13, np.uint8)
        encode_motion(axes, whole)
        return [whole.tobytes()]
    first, second = np.zeros((2, 7), np.uint8)
    encode_split(axes, first, second)
    return [first.tobytes(), second.tobytes()]


def pushes() -> list[tuple[int, ...]]:
    """Full deflection of each axis both ways, and hardly past the deadzone."""
    return [
        tuple(sign * size if a == axis else 0 for a in range(6))
        for size, axis, sign in product((FULL_SCALE_COUNTS, 24), range(6), (1, -1))
    ]


class Watched:
    """A session at rest whose ticks can be watched one by one."""

    def __init__(self, device: TeleopDevice, after_tick: Callable[[int], None] = lambda tick: None) -> None:
        """Take an arm that has been tared, with somebody at a device.

        Args:
            device: What the session reads.
            after_tick: Called when a tick is over, with its number; ticks of the tare are counted too.
        """
        task, rig, model = scenery(CONFIG.task, CONFIG.rig)

        def beat(attempt: Attempt) -> Callable[[np.ndarray], None]:
            return lambda rows: after_tick(attempt.plant.count - 1)

        self.attempt = Attempt(task, model, rig, CONFIG, seed=(0, 0, DEMONSTRATE), beat=beat)
        # The tick before the first period's first.
        self.start = self.attempt.plant.count - 1
        self.session = Session(self.attempt, CONFIG, device)

    def run(self, periods: int) -> np.ndarray:
        """Go on; returns all torques since the start. Shape (n, 7)."""
        for _ in range(periods):
            self.session.period()
        return self.attempt.plant.recorded["joint_command"].copy()


def undisturbed(periods: int) -> np.ndarray:
    """Torques of a run in which nobody touches the device. Shape (n, 7)."""
    return Watched(EmulatedSpaceMouse()).run(periods)


def ticks_to_torque(counts: Sequence[int], form: str, phase: int, calm: np.ndarray) -> int:
    """How many ticks after the one in which bytes came the first torque differs.

    Args:
        counts: What is said.
        form: Of `FORMS`.
        phase: In which tick of a period the bytes come, from 0; they come when its torque has been decided.
        calm: What `undisturbed` gave for `VIRTUAL_PERIODS`.
    """
    mouse = EmulatedSpaceMouse()
    sent = -1

    def after_tick(tick: int) -> None:
        if tick == sent:
            for report in reports_of(counts, form):
                mouse.send(report)

    watched = Watched(mouse, after_tick)
    sent = watched.start + 1 + _REST_PERIODS * PERIOD_TICKS + phase
    return first_difference(watched.run(VIRTUAL_PERIODS), calm) - sent


VIRTUAL_PERIODS = _REST_PERIODS + 6


def first_difference(torque: np.ndarray, calm: np.ndarray) -> int:
    """The first tick whose torques are not the same, to the bit; raises if there is none."""
    count = min(len(torque), len(calm))
    differ = (torque[:count] != calm[:count]).any(1)
    if not differ.any():
        raise AssertionError("no torque differs: the bytes moved nothing.")
    return int(differ.argmax())
