"""A gamepad as a device, over SDL's table of pads, which knows where each model has its sticks."""

import os
from typing import Any

import numpy as np

from wrenchflow.collect.devices.device import GRIPPER_BUTTON, MARK_BUTTON, Reading
from wrenchflow.collect.devices.needs import load
from wrenchflow.errors import DeviceError

FULL_SCALE_COUNTS = 32767
_LEVELS = 16  # Of rumble that are told apart: each change is a message to the pad.
_RUMBLE_MS = 60_000  # Until the pad rests by itself if nobody says anything any more.

# SDL is asked for pads alone: no window, none of the signals that end a session, none of pygame's greetings on stdout.
_SURROUNDINGS = {
    "SDL_VIDEODRIVER": "dummy",
    "SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS": "1",
    "SDL_NO_SIGNAL_HANDLERS": "1",
    "PYGAME_HIDE_SUPPORT_PROMPT": "1",
}
# What SDL calls them, for every pad: sticks are positive to the right and towards the person.
_LEFT_X, _LEFT_Y, _RIGHT_X, _RIGHT_Y, _LEFT_TRIGGER, _RIGHT_TRIGGER = range(6)
_A, _B, _LEFT_SHOULDER, _RIGHT_SHOULDER = 0, 1, 9, 10


def help_lines() -> tuple[str, ...]:
    """What sticks and buttons do, for a person."""
    return (
        "left stick: forward, back, left, right  right and left trigger: up, down",
        "right stick: turn to the left or right, tilt forward or back",
        "shoulders: roll to the left or right  A: gripper  B: mark",
    )


class Gamepad:
    """A `TeleopDevice` of a pad that SDL has opened.

    SDL is asked for the state of the pad at each read. While anything is deflected or pressed, each read is a report of
    its own: a stick that is held still says nothing.
    """

    name = "gamepad"
    full_scale_counts = FULL_SCALE_COUNTS

    def __init__(self, pad: Any, pump: Any) -> None:
        """Take a pad; `open_gamepad` finds one.

        Args:
            pad: What pygame calls a controller.
            pump: Lets SDL take in what the pads said; never waits.
        """
        self._pad, self._pump, self._label = pad, pump, str(pad.name)
        self._reported = (0,) * 7
        self._t_ns, self._level = 0, 0

    def read(self, now_ns: int) -> Reading:
        """Take in where sticks and buttons are."""
        if self._pad is None:
            raise DeviceError(f"the gamepad '{self._label}' was closed, and cannot be read any more.")
        self._pump()
        if not self._pad.attached():
            raise DeviceError(
                f"the gamepad '{self._label}' has gone: plug it in again, or let its battery charge, and start the "
                "episode anew."
            )
        axis, button = self._pad.get_axis, self._pad.get_button
        roll = int(button(_RIGHT_SHOULDER)) - int(button(_LEFT_SHOULDER))
        counts = np.array(
            [
                -axis(_LEFT_Y),
                -axis(_LEFT_X),
                axis(_RIGHT_TRIGGER) - axis(_LEFT_TRIGGER),
                roll * FULL_SCALE_COUNTS,
                -axis(_RIGHT_Y),
                -axis(_RIGHT_X),
            ],
            np.int64,
        )
        # The far end of a stick is one count more to the left than to the right.
        counts = np.clip(counts, -FULL_SCALE_COUNTS, FULL_SCALE_COUNTS)
        buttons = int(button(_A)) << GRIPPER_BUTTON | int(button(_B)) << MARK_BUTTON
        said = (*counts.tolist(), buttons)
        if any(said) or said != self._reported:
            self._t_ns = max(self._t_ns, now_ns)
        self._reported = said
        return Reading(t_ns=self._t_ns, counts=counts, buttons=buttons)

    def feel(self, share: float) -> None:
        """Rumble, where the pad can."""
        level = round(min(max(share, 0.0), 1.0) * _LEVELS)
        if self._pad is not None and level != self._level:
            self._pad.rumble(level / _LEVELS, level / _LEVELS, _RUMBLE_MS if level else 0)
            self._level = level

    def close(self) -> None:
        """Let go of the pad."""
        if self._pad is not None:
            self.feel(0.0)
            self._pad.quit()
        self._pad = None


def open_gamepad() -> Gamepad:
    """Find and open the first gamepad.

    Raises:
        DeviceError: If there is none; the message says what to do.
    """
    pygame = _pygame()
    controllers = load("pygame._sdl2.controller", package="pygame", device="gamepad")
    # Pads are told of by events, and SDL has events only where it has a display, if only a pretended one.
    pygame.display.init()
    pygame.joystick.init()
    controllers.init()
    pygame.event.clear()
    count = pygame.joystick.get_count()
    known = [index for index in range(count) if controllers.is_controller(index)]
    if not known:
        strange = [pygame.joystick.Joystick(index).get_name() for index in range(count)]
        seen = f"only {', '.join(strange)}, whose axes SDL has no table of" if strange else "none among the joysticks"
        raise DeviceError(
            f"no gamepad is there: {seen}. Plug one in or pair it; on Linux it shows as /dev/input/js0, which a "
            "container is given by --device /dev/input, and which the group `input` may read."
        )
    # Pumped and thrown away: nobody reads the events, a queue that is full forgets the newest, and making objects of
    # those of a pad that was opened as a controller fails in pygame.
    return Gamepad(controllers.Controller(known[0]), pygame.event.clear)


def _pygame() -> Any:
    for name, value in _SURROUNDINGS.items():
        os.environ.setdefault(name, value)
    return load("pygame", package="pygame", device="gamepad")
