"""The keyboard of the terminal as a device: a key moves one axis at the chosen speed while it is held."""

from collections.abc import Collection
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from wrenchflow.collect.devices.device import GRIPPER_BUTTON, MARK_BUTTON, Reading
from wrenchflow.collect.keys import Key
from wrenchflow.config import require_positive
from wrenchflow.errors import DeviceError

FULL_SCALE_COUNTS = 1000

# Key: axis of x y z rx ry rz, sense, and what the tool does, as seen by who faces the arm's way.
MOVES = {
    "w": (0, 1, "forward"),
    "s": (0, -1, "back"),
    "a": (1, 1, "left"),
    "d": (1, -1, "right"),
    "r": (2, 1, "up"),
    "f": (2, -1, "down"),
    "j": (3, -1, "roll to the left"),
    "l": (3, 1, "roll to the right"),
    "i": (4, 1, "tilt forward"),
    "k": (4, -1, "tilt back"),
    "u": (5, 1, "turn to the left"),
    "o": (5, -1, "turn to the right"),
}
SPEEDS = {"1": 0.15, "2": 0.3, "3": 0.6, "4": 1.0}  # Shares of full speed; all are past a deadzone of 5 %.
BUTTONS = {"space": (GRIPPER_BUTTON, "gripper"), "m": (MARK_BUTTON, "mark")}
NAMES = frozenset({*MOVES, *SPEEDS, *BUTTONS})


def help_lines() -> tuple[str, ...]:
    """What the keys do, for a person."""
    moves = [f"{key}: {what}" for key, (_, _, what) in MOVES.items()]
    speeds = ", ".join(f"{key} {share:.0%}" for key, share in SPEEDS.items())
    buttons = [f"{key}: {what}" for key, (_, what) in BUTTONS.items()]
    parts = (moves[:6], moves[6:10], [*moves[10:], *buttons], [f"speed: {speeds}"])  # None wider than a small terminal.
    return tuple("  ".join(part) for part in parts)


@runtime_checkable
class KeySource(Protocol):
    """What keys come from: `wrenchflow.collect.keys.Keys`."""

    @property
    def is_there(self) -> bool:
        """Whether there is a keyboard."""
        ...

    @property
    def has_releases(self) -> bool:
        """Whether keys say when they are let go of."""
        ...

    def take(self, names: Collection[str] | None = None) -> list[Key]:
        """What happened to these keys since they were last taken; never waits."""
        ...


@dataclass(frozen=True, kw_only=True)
class Holds:
    """How long a key that was pressed counts as held.

    A terminal without release events first sends a key once, waits for 0.25 to 0.7 s, and then repeats it some 30 times
    a second. Bridging that wait would let every tap run on for as long, 2 cm at a middling speed, into whatever the
    tool is about to touch. So a first press is a short step, and an arm that pauses before it goes on is the price;
    `first_s` is there for those who would rather pay with the step.

    Attributes:
        first_s: After a first press, where there are no release events [s].
        repeat_s: After each repetition, likewise; longer than the time between two [s].
        silent_s: With release events, until a key counts as let go of if no key says anything at all [s]: a window that
            is not in front any more may never be told of the release.
    """

    first_s: float = 0.15
    repeat_s: float = 0.15
    silent_s: float = 2.0

    def __post_init__(self) -> None:
        require_positive(first_s=self.first_s, repeat_s=self.repeat_s, silent_s=self.silent_s)


class Keyboard:
    """A `TeleopDevice` of the keys of `MOVES`, `SPEEDS` and `BUTTONS`.

    While a key is held, each read is a report of its own; when none is, the keyboard is silent.
    """

    name = "keyboard"
    full_scale_counts = FULL_SCALE_COUNTS

    def __init__(self, keys: KeySource, holds: Holds | None = None) -> None:
        """Take the keys of a terminal, which others may listen to as well.

        Raises:
            DeviceError: If there is no terminal.
        """
        if not keys.is_there:
            raise DeviceError(
                "no keyboard is there: stdin and stderr are not those of a terminal. Run this in a terminal, without "
                "redirecting them; ssh and docker run give one with -t."
            )
        self._keys, self._holds = keys, holds or Holds()
        self._until_ns: dict[str, int] = {}  # Keys that count as held, and until when.
        self.slow_down()
        self._reported = (0,) * 7
        self._t_ns, self._closed = 0, False

    @property
    def speed(self) -> tuple[str, float]:
        """The key that chose it, and its share of full speed."""
        return self._speed, SPEEDS[self._speed]

    def slow_down(self) -> None:
        """Choose the speed with which a newcomer lands without a blow."""
        self._speed = next(iter(SPEEDS))

    def read(self, now_ns: int) -> Reading:
        """Take in the keys since the last read."""
        if self._closed or not self._keys.is_there:
            raise DeviceError("the keyboard has gone with its terminal: start again in a terminal that stays.")
        for key in self._keys.take(NAMES):
            self._take_in(key, now_ns)
        self._until_ns = {name: until for name, until in self._until_ns.items() if until > now_ns}
        counts, buttons = np.zeros(6, np.int64), 0
        for name in self._until_ns:
            if name in MOVES:
                axis, sense, _ = MOVES[name]
                counts[axis] += round(sense * SPEEDS[self._speed] * FULL_SCALE_COUNTS)
            else:
                buttons |= 1 << BUTTONS[name][0]
        said = (*counts.tolist(), buttons)
        if any(said) or said != self._reported:
            self._t_ns = max(self._t_ns, now_ns)
        self._reported = said
        return Reading(t_ns=self._t_ns, counts=counts, buttons=buttons)

    def feel(self, share: float) -> None:
        """Nothing: a keyboard cannot be felt."""

    def close(self) -> None:
        """Stop listening; the terminal is its owner's to put back."""
        self._closed = True

    def _take_in(self, key: Key, now_ns: int) -> None:
        if key.name in SPEEDS:
            if key.act == "press":
                self._speed = key.name
        elif key.act == "release":
            self._until_ns.pop(key.name, None)
        elif self._keys.has_releases:
            # The key that was pressed last repeats for all that are held.
            self._until_ns[key.name] = 0
            self._until_ns = dict.fromkeys(self._until_ns, now_ns + round(self._holds.silent_s * 1e9))
        else:
            held = self._holds.repeat_s if key.name in self._until_ns else self._holds.first_s
            self._until_ns[key.name] = max(self._until_ns.get(key.name, 0), now_ns + round(held * 1e9))
