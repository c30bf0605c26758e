"""The keyboard as a device: how long a key counts as held, whether or not the terminal tells of releases."""

import re

import pytest

from hands.typist import Typist
from wrenchflow.collect.devices.keyboard import BUTTONS, MOVES, NAMES, SPEEDS, Holds, Keyboard, help_lines
from wrenchflow.errors import ConfigError, DeviceError

S = 1_000_000_000


def test_each_axis_has_a_key_for_either_sense():
    assert sorted((axis, sense) for axis, sense, _ in MOVES.values()) == [(a, s) for a in range(6) for s in (-1, 1)]
    assert len(NAMES) == len(MOVES) + len(SPEEDS) + len(BUTTONS)
    assert {re.split(":| ", part)[0] for line in help_lines() for part in line.split("  ")} >= {*MOVES, *BUTTONS}


@pytest.mark.parametrize("has_releases", [True, False])
def test_a_key_moves_its_axis_by_the_speed(has_releases):
    for name, (axis, sense, _) in MOVES.items():
        for key, share in SPEEDS.items():
            typist = Typist(has_releases=has_releases)
            device = Keyboard(typist)
            typist.press(key)
            typist.press(name)
            expected = [0] * 6
            expected[axis] = round(sense * share * device.full_scale_counts)
            assert device.read(S).counts.tolist() == expected


def test_an_attempt_begins_at_the_slowest_speed():
    typist = Typist()
    device = Keyboard(typist)
    slowest = min(SPEEDS, key=lambda key: SPEEDS[key])
    assert device.speed == (slowest, SPEEDS[slowest])
    typist.press("4")
    device.read(S)
    assert device.speed == ("4", SPEEDS["4"])
    device.slow_down()
    assert device.speed == (slowest, SPEEDS[slowest])


def test_without_releases_a_tap_is_a_short_step():
    typist = Typist()
    device = Keyboard(typist)
    typist.press("w")
    moving = [device.read(S + ms * S // 1000).counts[0] > 0 for ms in (0, 100, 149, 150, 300)]
    assert moving == [True, True, True, False, False]


def test_without_releases_a_key_that_repeats_moves_on_and_stops_soon_after():
    typist = Typist()
    device = Keyboard(typist)
    moving = []
    for ms in range(0, 1000, 10):
        if ms == 0 or (500 <= ms <= 800 and ms % 30 == 0):
            typist.press("w")  # A terminal shows a repetition as another press.
        moving.append(bool(device.read(S + ms * S // 1000).counts[0]))
    # From 0 to 150 ms, then the wait of the terminal, then from the first repetition to 150 ms after the last, at 780.
    expected = [ms < 150 or 510 <= ms < 780 + 150 for ms in range(0, 1000, 10)]
    assert moving == expected


def test_a_longer_first_step_bridges_the_wait():
    typist = Typist()
    device = Keyboard(typist, Holds(first_s=0.7))
    moving = []
    for ms in range(0, 1000, 10):
        if ms == 0 or (500 <= ms <= 800 and ms % 30 == 0):
            typist.press("w")
        moving.append(bool(device.read(S + ms * S // 1000).counts[0]))
    assert moving == [ms < 930 for ms in range(0, 1000, 10)]
    with pytest.raises(ConfigError):
        Holds(first_s=0.0)


def test_a_repetition_never_shortens_a_step():
    typist = Typist()
    device = Keyboard(typist, Holds(first_s=0.7))
    typist.press("w")
    device.read(S)
    typist.press("w")
    device.read(S + S // 10)
    assert device.read(S + 6 * S // 10).counts.any()


def test_with_releases_a_key_holds_until_its_release():
    typist = Typist(has_releases=True)
    device = Keyboard(typist)
    typist.press("w")
    typist.press("a")
    reading = device.read(S)
    assert reading.counts[:2].all()
    typist.release("w")
    assert (device.read(S + S // 10).counts[:2] != 0).tolist() == [False, True]
    typist.release("a")
    last = device.read(S + S // 5)
    assert not last.counts.any()
    assert last.t_ns == S + S // 5


def test_a_key_that_nobody_says_anything_about_any_more_is_let_go_of():
    typist = Typist(has_releases=True)
    device = Keyboard(typist)
    typist.press("w")
    typist.press("a")
    for ms in range(0, 3000, 100):
        typist.repeat("a")  # The last key repeats for all.
        assert device.read(S + ms * S // 1000).counts[:2].all()
    assert device.read(S + 2900 * S // 1000 + 19 * S // 10).counts[:2].all()
    assert not device.read(S + 2900 * S // 1000 + 2 * S).counts.any()


def test_opposite_keys_cancel_and_buttons_are_held_too():
    typist = Typist(has_releases=True)
    device = Keyboard(typist)
    for name in ("w", "s", "space"):
        typist.press(name)
    reading = device.read(S)
    assert (reading.counts.any(), reading.buttons) == (False, 1)
    typist.press("m")
    typist.release("space")
    assert device.read(S + 1).buttons == 2


def test_keys_of_others_are_left_to_them():
    typist = Typist()
    device = Keyboard(typist)
    for name in ("left", "w", "escape"):
        typist.press(name)
    device.read(S)
    assert [key.name for key in typist.take()] == ["left", "escape"]


def test_without_a_terminal_there_is_no_keyboard():
    with pytest.raises(DeviceError, match=r"no keyboard is there.*Run this in a terminal"):
        Keyboard(Typist(is_there=False))
