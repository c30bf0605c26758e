"""A keyboard without a terminal: keys that a test presses."""

from collections.abc import Collection

from wrenchflow.collect.keys import Key


class Typist:
    """A `KeySource`."""

    def __init__(self, *, has_releases: bool = False, is_there: bool = True) -> None:
        self.has_releases, self.is_there = has_releases, is_there
        self._keys: list[Key] = []

    def press(self, name: str) -> None:
        self._keys.append(Key(name, "press"))

    def repeat(self, name: str) -> None:
        self._keys.append(Key(name, "repeat"))

    def release(self, name: str) -> None:
        assert self.has_releases
        self._keys.append(Key(name, "release"))

    def take(self, names: Collection[str] | None = None) -> list[Key]:
        taken = [key for key in self._keys if names is None or key.name in names]
        self._keys = [key for key in self._keys if key not in taken]
        return taken
