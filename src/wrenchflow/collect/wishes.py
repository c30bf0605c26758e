"""What a person wants done with an attempt, by the keys that LeRobot has for it."""

import time
from collections.abc import Callable, Collection
from typing import Protocol, runtime_checkable

KEEP, REDO, STOP = "right", "left", "escape"
HELP = (
    "right: end and keep   left: discard and redo",
    "escape: stop after this one   Ctrl-C: emergency stop",
)
# An arrow that comes so soon was meant for the attempt before: that ended by itself just then, or it was pressed twice.
GRACE_S = 0.5
_NAP_S = 0.02


@runtime_checkable
class PressedKeys(Protocol):
    """Where keys come from: `collect.keys.Keys`."""

    @property
    def is_there(self) -> bool:
        """Whether there is a keyboard."""
        ...

    def pressed(self, names: Collection[str] | None = None) -> list[str]:
        """Names of the keys that were pressed since they were last taken; never waits."""
        ...


class Wishes:
    """Keys, and what they mean.

    Attributes:
        ending: `KEEP` or `REDO` once somebody wants this attempt to end so; else empty.
        is_last: Whether there shall be no more after this one.
    """

    def __init__(self, keys: PressedKeys) -> None:
        """Take the keys of a terminal."""
        self._keys = keys
        self.ending, self.is_last = "", False

    @property
    def can_ask(self) -> bool:
        """Whether there is somebody to ask."""
        return self._keys.is_there

    def begin(self) -> None:
        """An attempt begins: what was pressed before it was not about it."""
        self._keys.pressed((KEEP, REDO, STOP))
        self.ending = ""

    def look(self, elapsed_s: float) -> str:
        """Take in what was pressed; returns `ending`. Escape twice ends the attempt as well.

        Args:
            elapsed_s: For how long the attempt has been under way; before `GRACE_S` only escape counts [s].
        """
        for key in self._keys.pressed((KEEP, REDO, STOP)):
            if key == STOP and not self.is_last:
                self.is_last = True
            elif key == STOP or elapsed_s >= GRACE_S:
                self.ending = REDO if key == REDO else KEEP
        return self.ending

    def ask(self, is_over: Callable[[], bool]) -> str:
        """Wait for one of the keys; `STOP` where nobody can press one any more.

        Args:
            is_over: Whether there is no use in waiting, such as after an emergency stop.
        """
        while self._keys.is_there and not is_over():
            for key in self._keys.pressed((KEEP, REDO, STOP)):
                return key
            time.sleep(_NAP_S)
        return STOP
