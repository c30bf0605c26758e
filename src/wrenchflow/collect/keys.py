"""Keys of the terminal, without waiting: one reader for all who listen, each of whom takes the keys it knows.

Where the terminal answers to the kitty keyboard protocol a key also says when it is let go of; elsewhere a key that is
held is only seen to repeat.
"""

import re
import signal
import sys
import termios
import time
from collections import deque
from collections.abc import Collection
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Literal, NamedTuple

from wrenchflow.collect.devices.needs import load

# An arrow key comes as an escape and two more bytes. Where a network parts them, the rest is this late at most; then
# the escape was the key of that name.
_ESCAPE_S = 0.05
_BEGINNINGS = ("\x1b", "\x1b[", "\x1bO")
_REST = re.compile(r"[0-?]*[ -/]*[@-~]")  # Of a control sequence after its first two bytes.
_ANSWER_S = 0.5  # Until then a terminal has answered what it can, or never does.
_MOST_KEYS = 256  # That nobody has taken; older ones are forgotten.

_NAMES = {
    "KEY_LEFT": "left",
    "KEY_RIGHT": "right",
    "KEY_UP": "up",
    "KEY_DOWN": "down",
    "KEY_ESCAPE": "escape",
    "KEY_EXIT": "escape",
    "KEY_ENTER": "enter",
    "KEY_BACKSPACE": "backspace",
    "KEY_DELETE": "backspace",  # What some terminals send for it.
    "KEY_TAB": "tab",
    "KEY_SPACE": "space",
}
_CHARACTERS = {" ": "space", "\n": "enter", "\r": "enter", "\x1b": "escape", "\x7f": "backspace", "\b": "backspace"}
# Where all keys come as events, the terminal does not make signals of these any more.
_SIGNALS = {"KEY_CTRL_C": signal.SIGINT, "KEY_CTRL_BACKSLASH": signal.SIGQUIT}
_MODIFIERS = ("_CTRL_", "_ALT_", "_SUPER_", "_HYPER_", "_META_")


class Key(NamedTuple):
    """Something that happened to a key.

    Attributes:
        name: Such as `w`, `left`, `right`, `up`, `down`, `space`, `escape`, `enter`, `backspace`; letters are small.
        act: Whether it was pressed, is held (it repeats), or was let go of.
    """

    name: str
    act: Literal["press", "repeat", "release"]


class Keys:
    """The keyboard of the terminal that this process runs in, from `with` until its end.

    with Keys() as keys:
        if "left" in keys.pressed(("left", "right")): ...

    Attributes:
        is_there: Whether there is a terminal to read; without one no key is ever pressed.
        has_releases: Whether the terminal says when a key is let go of.
    """

    def __init__(self, *, releases: bool = False) -> None:
        """Say what is wanted.

        Args:
            releases: Ask the terminal to say when keys are let go of. Ctrl-C is then a key among others, which becomes
                a signal at the next `take` only: for those who take keys many times a second.
        """
        self.is_there = self.has_releases = False
        self._wants_releases = releases
        self._waiting: deque[Key] = deque(maxlen=_MOST_KEYS)
        self._stack = ExitStack()
        self._terminal: Any = None
        self._escape_s: float | None = None

    def __enter__(self) -> "Keys":
        """Read the terminal key by key, without echo, if there is one.

        Raises:
            DeviceError: If there is a terminal, but no package to read it with.
        """
        # What a person is told goes to stderr, so that is the terminal; stdout may well be a file.
        if not all(stream is not None and stream.isatty() for stream in (sys.__stdin__, sys.__stderr__)):
            return self
        blessed = load("blessed", package="blessed", device="keyboard")
        with ExitStack() as stack:
            terminal = blessed.Terminal(stream=sys.__stderr__)
            stack.enter_context(terminal.cbreak())
            if self._wants_releases and terminal.get_kitty_keyboard_state(timeout=_ANSWER_S) is not None:
                # All keys as events: the plain form of a letter says nothing of its release.
                wanted = {"disambiguate": True, "report_events": True, "report_all_keys": True}
                stack.enter_context(terminal.enable_kitty_keyboard(**wanted, timeout=_ANSWER_S))
                self.has_releases = True
            self._stack = stack.pop_all()
        self._terminal, self.is_there = terminal, True
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave the terminal as it was, whatever happened; what was typed and not read is not for the shell."""
        if self.is_there:
            termios.tcflush(sys.__stdin__, termios.TCIFLUSH)  # pyright: ignore[reportArgumentType]
        self.is_there, self._terminal = False, None
        self._stack.close()

    def take(self, names: Collection[str] | None = None) -> list[Key]:
        """What happened since these keys were last taken; never waits.

        Args:
            names: Keys that the caller knows; those of others are left for others. None for all.
        """
        self._read()
        taken = [key for key in self._waiting if names is None or key.name in names]
        left = [key for key in self._waiting if names is not None and key.name not in names]
        self._waiting.clear()
        self._waiting.extend(left)
        return taken

    def pressed(self, names: Collection[str] | None = None) -> list[str]:
        """Names of the keys that were pressed, or that repeat, since they were last taken; never waits."""
        return [key.name for key in self.take(names) if key.act != "release"]

    def _read(self) -> None:
        while self._terminal is not None:
            try:
                stroke = self._terminal.inkey(timeout=0, esc_delay=0)
            except (EOFError, OSError):  # The terminal was closed.
                self.is_there, self._terminal = False, None
                return
            if not stroke:
                return
            if str(stroke) not in _BEGINNINGS:
                self._escape_s = None
            elif self._goes_on(str(stroke)):
                return
            elif str(stroke) == "\x1b[":
                continue
            if (number := _SIGNALS.get(stroke.name or "")) is not None:
                signal.raise_signal(number)
            elif (key := key_of(stroke)) is not None:
                self._waiting.append(key)

    def _goes_on(self, beginning: str) -> bool:
        """Whether this may be part of a key whose rest still comes; of a key that nobody knows, drop the rest."""
        rest = self._terminal.flushinp()
        if rest:
            known = _REST.match(rest) if beginning == "\x1b[" else None
            self._terminal.ungetch(rest[known.end() :] if known else rest)
            self._escape_s = None
            return False
        now_s = time.monotonic()
        if self._escape_s is None:
            self._escape_s = now_s
        if now_s - self._escape_s < _ESCAPE_S:
            self._terminal.ungetch(beginning)
            return True
        self._escape_s = None
        return False


def key_of(stroke: Any) -> Key | None:
    """What a keystroke of blessed means; None for what is no key here, such as an answer of the terminal."""
    act: Literal["press", "repeat", "release"]
    act = "release" if stroke.released else "repeat" if stroke.repeated else "press"
    known = stroke.key_name or ""
    if any(modifier in known for modifier in _MODIFIERS):
        return None  # Somebody who holds Ctrl means something else than the letter.
    name = _NAMES.get(known)
    if name is None:
        character = stroke.key_value or str(stroke)
        name = _CHARACTERS.get(character, character.lower())
    is_key = name in _NAMES.values() or (len(name) == 1 and name.isprintable())
    return Key(name, act) if is_key else None
