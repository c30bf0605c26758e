"""What every format of a data set keeps, and what reading it refuses."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from wrenchflow.datasets import lerobot, lerobot_reader, robomimic, robomimic_reader
from wrenchflow.datasets.about import About
from wrenchflow.datasets.checks import Admission
from wrenchflow.datasets.load import load_steps
from wrenchflow.errors import DatasetError, OutputError
from wrenchflow.force_filter import FilterConfig
from wrenchflow.observation import OBSERVATIONS, Steps

FORMATS = {
    "robomimic": (robomimic, robomimic_reader.read, "robomimic.hdf5"),
    "lerobot": (lerobot, lerobot_reader.read, "lerobot"),
}
ABOUT = About(wrench_group_delay_s=0.0104)


def steps_of(lengths=(12, 5, 1, 9), seed=0, period_ns=50_000_000) -> list[Steps]:
    rng = np.random.default_rng(seed)
    return [
        Steps(
            episode_id=f"{i:04d}",
            t=1_700_000_000_000_000_007 + np.arange(n, dtype=np.int64) * period_ns,
            period_ns=period_ns,
            observations={
                name: rng.normal(0.0, 10.0, (n, *shape)).astype(np.float32) for name, shape in OBSERVATIONS.items()
            },
            actions=rng.normal(0.0, [3.0, 0.2, 0.2, *[0.4] * 6], (n, 9)).astype(np.float32),
            success=i % 2 == 0,
            wrench_filter=FilterConfig(cutoff_hz=25.0, median_samples=5),
            recording_id=f"{i // 2:04d}",
            task=("peg-insertion", "surface-wiping")[i % 2],
            operator="expert" if i else "",
            skew_ns={name: rng.integers(0, 10**6, n) for name in ("tcp_pose", "wrench")},
            valid={name: rng.random(n) < 0.9 for name in ("tcp_pose", "wrench")},
        )
        for i, n in enumerate(lengths)
    ]


def assert_same(read: list[Steps], written: list[Steps]) -> None:
    assert len(read) == len(written)
    for one, other in zip(read, written, strict=True):
        for name in ("episode_id", "period_ns", "success", "recording_id", "task", "operator"):
            assert getattr(one, name) == getattr(other, name), name
        for ours, theirs in ((one.skew_ns, other.skew_ns), (one.valid, other.valid)):
            assert list(ours) == list(theirs)
            for name in ours:
                np.testing.assert_array_equal(ours[name], theirs[name], strict=True)
        assert one.wrench_filter == other.wrench_filter
        np.testing.assert_array_equal(one.t, other.t, strict=True)
        assert one.actions.tobytes() == other.actions.tobytes()
        assert one.observations.keys() == other.observations.keys()
        for name in one.observations:
            assert one.observations[name].dtype == np.float32
            assert one.observations[name].shape == other.observations[name].shape
            assert one.observations[name].tobytes() == other.observations[name].tobytes(), name


def bytes_of(path: Path) -> dict[str, bytes]:
    files = [path] if path.is_file() else sorted(file for file in path.rglob("*") if file.is_file())
    return {str(file.relative_to(path)): file.read_bytes() for file in files}


@pytest.fixture(params=list(FORMATS))
def format(request):
    return FORMATS[request.param]


class TestEveryFormat:
    @pytest.fixture(autouse=True)
    def _place(self, format, tmp_path):
        self.module, self.read, name = format
        self.path = tmp_path / name

    def test_what_is_written_is_read_back_bit_for_bit(self):
        written = steps_of()
        self.module.write(self.path, written, ABOUT)
        assert_same(self.read(self.path), written)
        assert_same(load_steps(self.path), written)
        assert_same(load_steps(self.path.parent), written)

    def test_the_window_may_be_left_out(self):
        written = [
            replace(one, observations={name: v for name, v in one.observations.items() if name != "wrench_window"})
            for one in steps_of()
        ]
        self.module.write(self.path, written, ABOUT)
        assert_same(self.read(self.path), written)

    def test_equal_steps_give_equal_bytes(self, tmp_path):
        other = tmp_path / "again" / self.path.name
        self.module.write(self.path, steps_of(), ABOUT)
        time.sleep(1.1)  # Time stamps in HDF5 are whole seconds.
        self.module.write(other, steps_of(), ABOUT)
        assert bytes_of(self.path) == bytes_of(other)

    def test_what_is_there_is_replaced_only_when_told(self):
        self.module.write(self.path, steps_of(), ABOUT)
        with pytest.raises(OutputError, match="exists already"):
            self.module.write(self.path, steps_of(seed=1), ABOUT)
        assert_same(self.read(self.path), steps_of())
        self.module.write(self.path, steps_of(seed=1), ABOUT, overwrite=True)
        assert_same(self.read(self.path), steps_of(seed=1))
        assert not list(self.path.parent.glob("*.partial"))

    def test_a_write_that_fails_leaves_nothing_that_looks_whole(self, monkeypatch):
        def interrupt(*_args, **_kwargs):
            raise KeyboardInterrupt

        monkeypatch.setattr(Admission, "admit", interrupt)
        with pytest.raises(KeyboardInterrupt):
            self.module.write(self.path, steps_of(), ABOUT)
        assert [entry.suffix for entry in self.path.parent.iterdir()] == [".partial"]
        monkeypatch.undo()
        self.module.write(self.path, steps_of(), ABOUT)
        assert_same(self.read(self.path), steps_of())

    def test_steps_that_make_no_data_set_are_refused_before_anything_is_written(self):
        one, other = steps_of((3, 4))
        nan = {**other.observations, "wrench": np.full((4, 6), np.nan, np.float32)}
        less = {name: values for name, values in other.observations.items() if name != "goal_pose"}
        cases = {
            r"there is no episode": [],
            r"episode 0000 is there twice": [one, replace(other, episode_id="0000")],
            r"0001 has a step every 1 ns, expected 50000000 ns as in episode 0000": [one, replace(other, period_ns=1)],
            r"'wrench' of episode 0001: the value of step 0 is not finite": [one, replace(other, observations=nan)],
            r"0001 has no observation 'goal_pose'\. It has: tcp_pose": [one, replace(other, observations=less)],
            r"episode 0000 has no steps": steps_of((0,)),
        }
        for message, steps in cases.items():
            with pytest.raises(DatasetError, match=message):
                self.module.write(self.path, steps, ABOUT)
        assert not self.path.exists()

    def test_a_place_that_cannot_be_written_to_is_said_in_one_line(self, tmp_path):
        (tmp_path / "file").write_text("")
        with pytest.raises(OutputError, match="cannot be") as caught:
            self.module.write(tmp_path / "file" / self.path.name, steps_of(), ABOUT)
        assert "\n" not in str(caught.value)

    def test_what_is_not_there_is_said(self):
        with pytest.raises(DatasetError, match="does not exist"):
            self.read(self.path)
        with pytest.raises(DatasetError, match="does not exist"):
            load_steps(self.path)

    def test_damaged_files_are_refused_in_one_line(self, tmp_path):
        self.module.write(self.path, steps_of(), ABOUT)
        for relative, content in bytes_of(self.path).items():
            file = self.path / relative if self.path.is_dir() else self.path
            for damage in (content[: len(content) // 2], b"", b"not this at all"):
                if file.name in ("stats.json", "tasks.parquet"):
                    continue  # For LeRobot's use, not for ours.
                file.write_bytes(damage)
                with pytest.raises(DatasetError) as caught:
                    self.read(self.path)
                assert "\n" not in str(caught.value)
            file.write_bytes(content)
        assert_same(self.read(self.path), steps_of())


def test_both_formats_hold_the_same_steps(tmp_path):
    for module, _, name in FORMATS.values():
        module.write(tmp_path / name, steps_of(), ABOUT)
    assert_same(robomimic_reader.read(tmp_path / "robomimic.hdf5"), lerobot_reader.read(tmp_path / "lerobot"))


def test_a_folder_of_something_else_says_what_was_expected(tmp_path):
    (tmp_path / "0000.mcap").write_bytes(b"")
    with pytest.raises(DatasetError, match=r"expected robomimic\.hdf5, lerobot/ or meta/info\.json, got 0000\.mcap"):
        load_steps(tmp_path)
