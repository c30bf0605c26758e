"""The bytes of a SpaceMouse: what is written is read, and whatever else arrives moves nothing that it should not."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hands.wire import Wire, pressed, split, whole
from wrenchflow.collect.devices import hid_report
from wrenchflow.collect.devices.spacemouse import SpaceMouse
from wrenchflow.errors import DeviceError
from wrenchflow.spacemouse_models import model_of

axes = st.lists(st.integers(-2000, 2000), min_size=6, max_size=6)
# Of the right ids and lengths, with any number on an axis: random bytes alone seldom get past the first question.
raw = st.one_of(st.integers(-2100, 2100), st.integers(-(2**15), 2**15 - 1))
motions = st.one_of(
    *(
        st.lists(raw, min_size=count, max_size=count).map(lambda v, kind=kind: struct.pack(f"<B{len(v)}h", kind, *v))
        for kind, count in ((1, 6), (1, 3), (2, 3), (2, 6))
    )
)
reports = st.one_of(
    motions,
    st.binary(max_size=20),
    st.tuples(st.sampled_from([1, 2, 3, 0x17]), st.binary(max_size=13)).map(lambda parts: bytes([parts[0]]) + parts[1]),
)


def decode(report: bytes, counts: np.ndarray, buttons: np.ndarray) -> int:
    # What stands past the report's end is whatever was there before.
    array = np.frombuffer(report + b"\xa5" * 8, np.uint8).copy()
    return int(hid_report.decode(array, len(report), counts, buttons))


@given(counts=axes, before=axes)
def test_written_counts_are_read_in_either_form(counts, before):
    for sent in ((whole(*counts),), split(*counts)):
        found, buttons = np.array(before, np.int64), np.array([5], np.int64)
        assert [decode(report, found, buttons) for report in sent] == [hid_report.SOUND] * len(sent)
        assert (found.tolist(), buttons.tolist()) == (counts, [5])


@given(counts=st.lists(st.integers(-(2**40), 2**40), min_size=6, max_size=6))
def test_counts_that_no_device_reports_saturate(counts):
    found, buttons = np.zeros(6, np.int64), np.zeros(1, np.int64)
    assert decode(whole(*counts), found, buttons) == hid_report.SOUND
    np.testing.assert_array_equal(found, np.clip(counts, -2000, 2000))


@given(buttons=st.integers(0, 2**48 - 1), length=st.integers(2, 7), before=axes)
def test_written_buttons_are_read_as_far_as_there_is_room(buttons, length, before):
    counts, found = np.array(before, np.int64), np.zeros(1, np.int64)
    assert decode(pressed(buttons, length), counts, found) == hid_report.SOUND
    assert (int(found[0]), counts.tolist()) == (buttons % 2 ** (8 * (length - 1)), before)


@given(report=reports, before=axes, held=st.integers(0, 2**48 - 1))
def test_any_bytes_are_read_as_the_format_says_or_change_nothing(report, before, held):
    counts, buttons = np.array(before, np.int64), np.array([held], np.int64)
    code = decode(report, counts, buttons)
    assert 0 <= code < len(hid_report.CODE_NAMES)
    # The format once more, apart from the decoder.
    expected, expected_held = list(before), held
    sizes = {(1, 13): 6, (1, 7): 3, (2, 7): 3}
    is_sound = False
    if report[:1] == b"\x03" and 2 <= len(report) <= 7:
        expected_held, is_sound = int.from_bytes(report[1:], "little"), True
    elif report and (report[0], len(report)) in sizes:
        said = struct.unpack(f"<{sizes[report[0], len(report)]}h", report[1:])
        if max(map(abs, said)) <= 2000:
            is_sound = True
            for i in range(0, len(said), 3):
                right, back, down = said[i : i + 3]
                start = i if report[0] == 1 else 3
                expected[start : start + 3] = [-back, -right, -down]
    assert (code == hid_report.SOUND) == is_sound
    assert (counts.tolist(), int(buttons[0])) == (expected, expected_held)


@pytest.mark.parametrize("product", [0xC635, 0xC62F, 0xFFFF])
@given(batches=st.lists(st.lists(reports, max_size=8), max_size=8), unplugs=st.booleans())
def test_whatever_a_mouse_sends_stays_within_its_scale_and_raises_nothing_unknown(product, batches, unplugs):
    model = model_of(0x256F, product)
    assert model is not None
    wire = Wire()
    mouse, last = SpaceMouse(wire, model), (0, np.zeros(6, np.int64))
    for i, batch in enumerate(batches):
        sound = False
        for report in batch:
            wire.put(report)
            if not report:
                break  # Nothing is what an empty wire says: what comes after it waits for the next read.
        reading = mouse.read(1 + i)
        assert np.abs(reading.counts).max() <= mouse.full_scale_counts
        assert reading.buttons in range(4)
        sound = reading.t_ns == 1 + i
        assert sound or (reading.t_ns == last[0] and (reading.counts == last[1]).all())
        last = reading.t_ns, reading.counts
    if unplugs:
        wire.unplug()
        with pytest.raises(DeviceError):
            mouse.read(100)


@pytest.mark.parametrize("kind", [1, 2, 3, 9, 0x17])
def test_a_length_beyond_the_bytes_is_refused(kind):
    for size in range(20):
        for length in range(-3, 25):
            counts, buttons = np.full(6, 7, np.int64), np.full(1, 9, np.int64)
            code = int(hid_report.decode(np.full(size, kind, np.uint8), length, counts, buttons))
            assert 1 <= length <= size or code == hid_report.WRONG_LENGTH
            assert code == hid_report.SOUND or ((counts == 7).all() and (buttons == 9).all())
