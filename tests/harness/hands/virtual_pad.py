"""A gamepad that SDL itself pretends: the very library that pygame has loaded takes it for one that is plugged in."""

import ctypes
from pathlib import Path

_PAD, _AXES, _BUTTONS = 1, 6, 15  # A gamepad, as SDL numbers its kinds of joysticks.


class VirtualPad:
    """Sticks, triggers and buttons of a pad without hardware; plugged in when it is made."""

    def __init__(self, kind: int = _PAD) -> None:
        maps = Path("/proc/self/maps").read_text()
        found = [line.split()[-1] for line in maps.splitlines() if "libSDL2-2" in line]
        assert found, "pygame is loaded before a pad is plugged in"
        self._sdl = sdl = ctypes.CDLL(found[0])
        sdl.SDL_JoystickFromInstanceID.restype = ctypes.c_void_p
        sdl.SDL_JoystickSetVirtualAxis.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_int16]
        sdl.SDL_JoystickSetVirtualButton.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_uint8]
        self._index = sdl.SDL_JoystickAttachVirtual(kind, _AXES, _BUTTONS, 0)
        assert self._index >= 0
        self._id = sdl.SDL_JoystickGetDeviceInstanceID(self._index)
        self.is_plugged_in = True

    @property
    def _handle(self) -> ctypes.c_void_p:
        handle = self._sdl.SDL_JoystickFromInstanceID(self._id)
        assert handle, "a pad is moved only while somebody has it open"
        return handle

    def move(self, axis: int, value: int) -> None:
        """Put a stick to -32768 to 32767; a trigger rests at -32768."""
        assert self._sdl.SDL_JoystickSetVirtualAxis(self._handle, axis, value) == 0

    def press(self, button: int, *, down: bool = True) -> None:
        assert self._sdl.SDL_JoystickSetVirtualButton(self._handle, button, int(down)) == 0

    def unplug(self) -> None:
        if self.is_plugged_in:
            assert self._sdl.SDL_JoystickDetachVirtual(self._index) == 0
        self.is_plugged_in = False
