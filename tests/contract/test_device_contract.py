"""What every `TeleopDevice` keeps to: one class of rules over all of them, each at a bench that plays its hand."""

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Protocol

import numpy as np
import pytest

from hands.teleoperator import deltas, increments
from hands.typist import Typist
from hands.virtual_pad import VirtualPad
from hands.wire import Wire, split, whole
from wrenchflow import signals
from wrenchflow.collect.devices.device import Reading, TeleopDevice
from wrenchflow.collect.devices.emulated_spacemouse import EmulatedSpaceMouse
from wrenchflow.collect.devices.gamepad import open_gamepad
from wrenchflow.collect.devices.keyboard import Keyboard
from wrenchflow.collect.devices.replay_device import Replay
from wrenchflow.collect.devices.spacemouse import SpaceMouse
from wrenchflow.episode import Stream
from wrenchflow.errors import DeviceError
from wrenchflow.spacemouse_models import model_of

START_NS, MS = 1_000_000_000, 1_000_000
# When, and how far forward the hand deflects the device; 1.4 is more than there is.
Script = list[tuple[int, float]]


class Bench(Protocol):
    """A device, and the hand that holds it. To join, a device needs one of these and a line in `BENCHES`."""

    device: TeleopDevice

    def deflect(self, share: float) -> None:
        """Push forward, at once; a report goes out."""

    def garbage(self) -> bool:
        """Let the device say what makes no sense; False for one that cannot."""

    def unplug(self) -> bool:
        """Take it away; False for one that cannot be."""

    def jam(self) -> None:
        """Let its source be what would keep a reader waiting."""

    def end(self) -> None:
        """Clear away what is behind the device."""


class _Bench:
    """What most benches share."""

    def garbage(self) -> bool:
        return False

    def unplug(self) -> bool:
        return False

    def jam(self) -> None: ...

    def end(self) -> None: ...


class MouseBench(_Bench):
    def __init__(self, product: int, *, is_split: bool) -> None:
        model = model_of(0x256F, product)
        assert model is not None
        self._full, self._is_split, self.wire = model.full_scale_counts, is_split, Wire()
        self.device = SpaceMouse(self.wire, model)

    def deflect(self, share: float) -> None:
        counts = (round(share * self._full), 0, 0, 0, 0, 0)
        for report in split(*counts) if self._is_split else (whole(*counts),):
            self.wire.put(report)

    def garbage(self) -> bool:
        self.wire.put(b"\x01\x02\x03\x04\x05")
        return True

    def unplug(self) -> bool:
        self.wire.unplug()
        return True

    def jam(self) -> None:
        self.deflect(0.5)
        self.wire.never_dry = True


class EmulatedBench(_Bench):
    """The mouse of the emulated person: a hand that makes report bytes, and the real one's driver."""

    def __init__(self) -> None:
        self.device = self._mouse = EmulatedSpaceMouse()

    def deflect(self, share: float) -> None:
        self._mouse.deflect(np.array([round(share * self._mouse.full_scale_counts), 0, 0, 0, 0, 0]))

    def garbage(self) -> bool:
        self._mouse.send(b"\x02\x01")
        return True


class KeyboardBench(_Bench):
    """A key is pressed or not; four is full speed."""

    def __init__(self) -> None:
        self._typist, self._held = Typist(has_releases=True), ""
        self.device = Keyboard(self._typist)
        self._typist.press("4")

    def deflect(self, share: float) -> None:
        if self._held:
            self._typist.release(self._held)
        self._held = "w" if share > 0.0 else "s" if share < 0.0 else ""
        if self._held:
            self._typist.press(self._held)

    def unplug(self) -> bool:
        self._typist.is_there = False
        return True


class GamepadBench(_Bench):
    def __init__(self) -> None:
        with pytest.raises(DeviceError, match="no gamepad is there"):
            open_gamepad()
        self._pad = VirtualPad()
        self.device = open_gamepad()

    def deflect(self, share: float) -> None:
        self._pad.move(1, round(np.clip(-share * 32768, -32768, 32767)))

    def unplug(self) -> bool:
        self._pad.unplug()
        return True

    def end(self) -> None:
        self._pad.unplug()


class TeleoperatorBench(_Bench):
    def __init__(self, folder: Path) -> None:
        self._fed, self.device = increments(folder)

    def deflect(self, share: float) -> None:
        self._fed.feed(deltas(share))

    def garbage(self) -> bool:
        self._fed.feed(deltas(float("nan")))
        return True

    def unplug(self) -> bool:
        self._fed.disconnect()
        self._fed.feed(ConnectionError("no port any more"))
        return True

    def end(self) -> None:
        self._fed.end()


class ReplayBench(_Bench):
    """The script of the rules below is the recording; the hand has moved already."""

    def __init__(self, script: Script) -> None:
        t = np.array([at for at, _ in script], np.int64)
        data = np.zeros((len(t), signals.JOY.width))
        data[:, 0] = [share * 350 for _, share in script]
        self.device = Replay(Stream(t, data, signals.JOY, "device"), full_scale_counts=350)

    def deflect(self, share: float) -> None: ...


BENCHES: dict[str, Callable[[Path, Script], Bench]] = {
    "spacemouse wired": lambda folder, script: MouseBench(0xC635, is_split=True),
    "spacemouse wireless": lambda folder, script: MouseBench(0xC62F, is_split=False),
    "emulated": lambda folder, script: EmulatedBench(),
    "keyboard": lambda folder, script: KeyboardBench(),
    "gamepad": lambda folder, script: GamepadBench(),
    "replay": lambda folder, script: ReplayBench(script),
    "lerobot": lambda folder, script: TeleoperatorBench(folder),
}


class Stage:
    """Plays a script at a bench, in time."""

    def __init__(self, make: Callable[[Script], Bench]) -> None:
        self._make, self._left = make, []

    def play(self, script: Script) -> Bench:
        self.bench, self._left = self._make(script), list(script)
        return self.bench

    def read(self, now_ns: int) -> Reading:
        while self._left and self._left[0][0] <= now_ns:
            self.bench.deflect(self._left.pop(0)[1])
        return self.bench.device.read(now_ns)


@pytest.fixture(params=BENCHES)
def stage(request, tmp_path) -> Iterator[Stage]:
    stage = Stage(lambda script: BENCHES[request.param](tmp_path, script))
    yield stage
    stage.bench.end()
    stage.bench.device.close()


REST_AND_PUSH: Script = [(START_NS, 0.0), (START_NS + 10 * MS, 1.0), (START_NS + 20 * MS, -1.0)]


class TestTeleopDevice:
    """The rules."""

    def test_it_says_who_it_is(self, stage: Stage):
        device = stage.play(REST_AND_PUSH).device
        assert isinstance(device, TeleopDevice)
        assert device.name
        assert device.full_scale_counts >= 1

    def test_a_push_forward_is_a_positive_x_and_nothing_else(self, stage: Stage):
        stage.play(REST_AND_PUSH)
        rest = stage.read(START_NS)
        assert not rest.counts.any()
        pushed = stage.read(START_NS + 10 * MS)
        assert pushed.counts.tolist() == [stage.bench.device.full_scale_counts, 0, 0, 0, 0, 0]
        assert (pushed.t_ns, pushed.problem, pushed.buttons) == (START_NS + 10 * MS, "", 0)

    def test_of_many_reports_the_newest_counts(self, stage: Stage):
        script: Script = [(START_NS, 0.0)]
        script += [(START_NS + i * MS, 1.0 if i % 2 else -1.0) for i in range(1, 61)]
        stage.play(script)
        stage.read(START_NS)
        reading = stage.read(START_NS + 60 * MS)
        assert reading.counts[0] == -stage.bench.device.full_scale_counts
        assert reading.t_ns == START_NS + 60 * MS

    def test_no_count_is_beyond_the_full_scale(self, stage: Stage):
        stage.play([(START_NS, 0.0), (START_NS + 5 * MS, 1.4), (START_NS + 10 * MS, -1.4)])
        full = stage.bench.device.full_scale_counts
        found = [stage.read(START_NS + i * 5 * MS).counts[0] for i in range(3)]
        assert found == [0, full, -full]

    def test_stamps_never_go_back_even_where_the_clock_does(self, stage: Stage):
        bench = stage.play([(START_NS + i * MS, 1.0 if i % 3 else -1.0) for i in range(50)])
        stamps = []
        for i, at in enumerate((0, 5, 3, 20, 20, 11, 30, 0, 49)):
            bench.deflect(0.5 if i % 2 else -0.5)  # Something new at every read, whatever the clock shows.
            stamps.append(stage.read(START_NS + at * MS).t_ns)
        assert stamps == sorted(stamps)
        assert stamps[0] == START_NS
        assert stamps[-1] == START_NS + 49 * MS

    def test_silence_leaves_the_old_stamp(self, stage: Stage):
        stage.play([(START_NS, 1.0), (START_NS + 10 * MS, 0.0)])
        stage.read(START_NS)
        last = stage.read(START_NS + 10 * MS)
        for later in (11, 200, 5000):
            reading = stage.read(START_NS + later * MS)
            assert (reading.t_ns, reading.counts.any(), reading.problem) == (last.t_ns, False, "")

    def test_garbage_is_told_until_something_sound_comes(self, stage: Stage):
        bench = stage.play([(START_NS, 0.0), (START_NS + 20 * MS, 1.0)])
        stage.read(START_NS)
        before = stage.read(START_NS + 5 * MS)
        if not bench.garbage():
            pytest.skip("it has no way to say what makes no sense")
        for _ in range(2):
            reading = stage.read(START_NS + 10 * MS)
            assert reading.problem
            assert (reading.t_ns, reading.counts.tolist()) == (before.t_ns, before.counts.tolist())
        reading = stage.read(START_NS + 20 * MS)
        assert (reading.problem, reading.t_ns) == ("", START_NS + 20 * MS)

    def test_a_device_that_goes_says_what_to_do(self, stage: Stage):
        bench = stage.play([(START_NS, 1.0)])
        stage.read(START_NS)
        if not bench.unplug():
            pytest.skip("nobody can take it away")
        for _ in range(2):
            with pytest.raises(DeviceError, match=r"has gone.*again"):
                stage.read(START_NS + 5 * MS)

    def test_what_was_read_stays_as_it_was(self, stage: Stage):
        stage.play(REST_AND_PUSH)
        stage.read(START_NS)
        pushed = stage.read(START_NS + 10 * MS)
        kept = pushed.counts.copy()
        stage.read(START_NS + 20 * MS)
        np.testing.assert_array_equal(pushed.counts, kept)

    def test_a_read_never_waits(self, stage: Stage):
        bench = stage.play([(START_NS, 0.0)])
        stage.read(START_NS)
        bench.jam()
        reading: list[Reading] = []
        reader = threading.Thread(target=lambda: reading.append(bench.device.read(START_NS + MS)), daemon=True)
        reader.start()
        reader.join(timeout=20.0)
        assert reading, "the reader hangs"

    def test_it_is_felt_from_nothing_to_all_and_closed_twice(self, stage: Stage):
        device = stage.play([(START_NS, 0.0)]).device
        for share in (0.0, 0.3, 1.0, 1.0, 0.0):
            device.feel(share)
        for _ in range(2):
            device.close()
        with pytest.raises(DeviceError):
            device.read(START_NS)
