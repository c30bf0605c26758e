"""What a SpaceMouse says over USB: the bytes of its HID reports to axis counts and buttons, and back, as kernels.

Report 1 of 13 bytes holds all six axes (wireless devices, and wired ones that are new); report 1 of 7 bytes holds the
three translations and report 2 of 7 bytes the three rotations (older wired devices). Report 3 holds the buttons, a bit
each. An axis is a signed whole number of 16 bits, its low byte first. Which form comes, the length says, so the decoder
need not know the model.

**Axes.** Seen by the person who holds it, the device's own x points right, y *towards the person* and z *down*; its
rotations are right-handed about these. Counts here have x forward (away from the person), y left and z up, and
rotations right-handed about those. `_AXIS` and `_SIGN` are the only place that knows.
"""

import numpy as np
from jaxtyping import Int64, UInt8

from wrenchflow.compiled import kernel

MOTION, ROTATION, BUTTONS = np.int64(1), np.int64(2), np.int64(3)  # Ids of reports: the first byte.
BATTERY, KEYS, KEYS_HELD = np.int64(0x17), np.int64(0x1C), np.int64(0x1D)  # Sound, but say nothing about the hand.
WHOLE_BYTES, SPLIT_BYTES = np.int64(13), np.int64(7)  # Lengths of a report of six and of three axes, id included.
BUTTON_BYTES = np.int64(7)  # The longest button report: an id and 48 buttons.

# No device reports more than four times the full scale of the strongest (500): such a number is no deflection.
PLAUSIBLE_COUNTS = np.int64(2000)

# Of the device's axis i (x right, y towards the person, z down): the axis of ours that it lies along, and its sense.
_AXIS = np.array([1, 0, 2], np.int64)
_SIGN = np.array([-1, -1, -1], np.int64)

# What `decode` answers. From WRONG_LENGTH on a report is refused.
SOUND, OF_NO_INTEREST, WRONG_LENGTH, UNKNOWN_ID, IMPLAUSIBLE = (np.int64(code) for code in range(5))
CODE_NAMES = ("sound", "of no interest", "wrong length", "unknown id", "implausible axis")


def refusal(code: int, kind: int, length: int) -> str:
    """Say, for a person, why a report was refused.

    Args:
        code: As `decode` answered, from `WRONG_LENGTH` on.
        kind: The report's id.
        length: Its bytes.
    """
    if code == UNKNOWN_ID:
        return f"a report of the unknown kind {kind}, expected 1, 2 or 3"
    if code == IMPLAUSIBLE:
        return f"a report of an axis beyond {PLAUSIBLE_COUNTS} counts, which no hand reaches"
    expected = {1: "7 or 13", 2: "7", 3: "2 to 7"}.get(kind, "2 or more")
    return f"a report {kind} of {length} bytes, expected {expected}"


@kernel
def decode(
    report: UInt8[np.ndarray, " n"],
    length: int | np.int64,
    counts: Int64[np.ndarray, " 6"],
    buttons: Int64[np.ndarray, " 1"],
) -> np.int64:
    """Take one report in.

    Args:
        report: Bytes as the device sent them, id first; what stands past `length` is not looked at. Shape (n,).
        length: How many of them were received.
        counts: x y z rx ry rz, overwritten where the report says them. Shape (6,).
        buttons: A bit each, as the device numbers them; overwritten likewise. Shape (1,).

    Returns:
        One of the codes above, as `CODE_NAMES` calls them. Unless it is `SOUND`, nothing was overwritten.
    """
    if length < 1 or length > report.size:
        return WRONG_LENGTH
    kind = np.int64(report[0])
    if kind == BUTTONS:
        if length < 2 or length > BUTTON_BYTES:
            return WRONG_LENGTH
        pressed = np.int64(0)
        for i in range(1, length):
            pressed |= np.int64(report[i]) << (8 * (i - 1))
        buttons[0] = pressed
        return SOUND
    if kind in (MOTION, ROTATION):
        if length != SPLIT_BYTES and not (kind == MOTION and length == WHOLE_BYTES):
            return WRONG_LENGTH
        axes = (length - 1) // 2
        for i in range(axes):
            if abs(_axis_of(report, i)) > PLAUSIBLE_COUNTS:
                return IMPLAUSIBLE
        first = 3 * (kind - MOTION)
        for i in range(axes):
            counts[first + 3 * (i // 3) + _AXIS[i % 3]] = _SIGN[i % 3] * _axis_of(report, i)
        return SOUND
    if kind in (BATTERY, KEYS, KEYS_HELD):
        return OF_NO_INTEREST
    return UNKNOWN_ID


@kernel
def encode_motion(counts: Int64[np.ndarray, " 6"], report: UInt8[np.ndarray, " 13"]) -> None:
    """Write all six axes as one report, as a wireless device sends them; beyond `PLAUSIBLE_COUNTS` they saturate.

    Args:
        counts: x y z rx ry rz. Shape (6,).
        report: What is sent, overwritten. Shape (13,).
    """
    report[0] = MOTION
    _put_axes(counts, 0, report, 0)
    _put_axes(counts, 3, report, 3)


@kernel
def encode_split(
    counts: Int64[np.ndarray, " 6"], first: UInt8[np.ndarray, " 7"], second: UInt8[np.ndarray, " 7"]
) -> None:
    """Write the axes as two reports, as an older wired device sends them; beyond `PLAUSIBLE_COUNTS` they saturate.

    Args:
        counts: x y z rx ry rz. Shape (6,).
        first: The report of translations, overwritten. Shape (7,).
        second: The report of rotations, overwritten. Shape (7,).
    """
    first[0] = MOTION
    _put_axes(counts, 0, first, 0)
    second[0] = ROTATION
    _put_axes(counts, 3, second, 0)


@kernel
def encode_buttons(buttons: int, report: UInt8[np.ndarray, " n"]) -> None:
    """Write the pressed buttons as a report that fills `report`; buttons that it has no room for are left out.

    Args:
        buttons: A bit each, as the device numbers them.
        report: What is sent, overwritten: 2 to 7 bytes, which is room for 8 to 48 buttons. Shape (n,).
    """
    report[0] = BUTTONS
    for i in range(1, report.size):
        report[i] = (buttons >> (8 * (i - 1))) & 0xFF


@kernel
def _axis_of(report, i):
    """The device's axis i, sign and all."""
    value = np.int64(report[1 + 2 * i]) | (np.int64(report[2 + 2 * i]) << 8)
    return value - 65536 if value >= 32768 else value


@kernel
def _put_axes(counts, start, report, place):
    """Write three counts from `start` on as the report's axes from `place` on."""
    for i in range(3):
        value = _SIGN[i] * min(max(counts[start + _AXIS[i]], -PLAUSIBLE_COUNTS), PLAUSIBLE_COUNTS)
        report[1 + 2 * (place + i)] = value & 0xFF
        report[2 + 2 * (place + i)] = (value >> 8) & 0xFF
