"""A sound when the force rises, more often the nearer it is to what the arm draws back from."""

import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from wrenchflow.collect.devices.needs import load
from wrenchflow.errors import DeviceError

FROM_SHARE = 0.5  # Of the force that the arm draws back from; below it is silence.
_SLOWEST_S, _FASTEST_S = 0.8, 0.2
_TONE_HZ, _TONE_S, _SAMPLES_HZ = 880.0, 0.08, 22050


class Tone:
    """Beeps by itself, at most five times a second."""

    def __init__(self, beep: Callable[[], None] | None = None, clock_s: Callable[[], float] = time.monotonic) -> None:
        """Find something to beep with.

        Args:
            beep: What makes the sound; without it a loudspeaker, and the terminal's bell where there is none.
            clock_s: Says what time it is.
        """
        self._beep, self._clock_s = beep or _loudspeaker() or _bell, clock_s
        self._next_s = 0.0

    def hear(self, share: float) -> None:
        """Beep if it is time to.

        Args:
            share: Of the force that the arm draws back from.
        """
        now_s = self._clock_s()
        if not share >= FROM_SHARE or now_s < self._next_s:
            return
        nearness = min((share - FROM_SHARE) / (1.0 - FROM_SHARE), 1.0)
        self._next_s = now_s + _SLOWEST_S + nearness * (_FASTEST_S - _SLOWEST_S)
        self._beep()


def _bell() -> None:
    sys.stderr.write("\a")
    sys.stderr.flush()


def _loudspeaker() -> Callable[[], None] | None:
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # It greets on stdout, where results go.
    try:
        pygame = load("pygame", package="pygame", device="loudspeaker")
        with _nothing_on_stderr():
            pygame.mixer.init(_SAMPLES_HZ, -16, 1)
    except (DeviceError, RuntimeError):  # None is installed, or there is none to be heard.
        return None
    t = np.arange(round(_TONE_S * _SAMPLES_HZ)) / _SAMPLES_HZ
    # It swells and fades, or it would click.
    wave = np.sin(2.0 * np.pi * _TONE_HZ * t) * np.sin(np.pi * t / _TONE_S) * 8000.0
    sound = pygame.mixer.Sound(buffer=wave.astype(np.int16).tobytes())

    def beep() -> None:
        sound.play()

    return beep


@contextmanager
def _nothing_on_stderr() -> Iterator[None]:
    """Sound libraries written in C tell the terminal at length that there is no sound."""
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
