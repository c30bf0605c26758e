"""To go on with a folder: the bytes are those of a run that nothing interrupted, and another configuration is named."""

import shlex
import shutil
from pathlib import Path

import pytest

from wrenchflow.collect import folder as collecting
from wrenchflow.collect.folder import collect_folder
from wrenchflow.collect.resume import BEGUN, set_aside
from wrenchflow.errors import OutputError

FLAGS = ("--tare-s", "0.4", "--operator", "emulated", "--seed", "6")


@pytest.fixture(scope="module")
def whole(wrenchflow, tmp_path_factory):
    """Four episodes in one go."""
    out = tmp_path_factory.mktemp("whole") / "raw"
    said = wrenchflow("collect", out, "--episodes", 4, *FLAGS, "--jobs", 1, "--json").result
    return out, said


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_finished_folder_grows_to_the_same_bytes(tmp_path, wrenchflow, whole, jobs):
    out, said = whole
    wrenchflow("collect", tmp_path / "raw", "--episodes", 2, *FLAGS, "--jobs", 1, "--json")
    more = wrenchflow("collect", tmp_path / "raw", "--episodes", 4, *FLAGS, "--jobs", jobs, "--resume", "--json")
    assert contents(tmp_path / "raw") == contents(out)
    assert {**more.result, "out": ""} == {**said, "out": ""}
    assert not (tmp_path / "raw.partial").exists()


@pytest.mark.parametrize("gone", [(1,), (0, 3), (0, 1, 2, 3)])
def test_an_interrupted_folder_is_completed_to_the_same_bytes(tmp_path, wrenchflow, whole, monkeypatch, gone):
    out, said = whole
    partial = tmp_path / "raw.partial"

    class Interrupted(collecting._Record):
        def __call__(self, index):
            if index in gone:
                (self.folder / "half.mcap.partial").write_text("half")
                raise KeyboardInterrupt
            return super().__call__(index)

    with monkeypatch.context() as patched:
        patched.setattr(collecting, "_Record", Interrupted)
        cut_off = wrenchflow("collect", tmp_path / "raw", "--episodes", 4, *FLAGS, "--jobs", 1, "--overwrite", "--json")
    assert cut_off.code == 130
    for index in range(gone[0] + 1, 4):  # As workers that were faster would have left them.
        if index not in gone:
            shutil.copy(next(out.glob(f"*-{index:04d}.mcap")), partial)
    assert (partial / BEGUN).exists()
    _, told = cut_off.stderr.split(" Go on with: wrenchflow ")
    ran = wrenchflow(*shlex.split(told))
    assert {**ran.result, "out": ""} == {**said, "out": ""}
    assert contents(tmp_path / "raw") == contents(out)


def test_nothing_is_there_yet_and_all_is_recorded(tmp_path, wrenchflow, whole):
    out, _ = whole
    wrenchflow("collect", tmp_path / "raw", "--episodes", 4, *FLAGS, "--jobs", 1, "--resume")
    assert contents(tmp_path / "raw") == contents(out)


def test_another_configuration_is_refused_and_named_and_nothing_is_touched(tmp_path, wrenchflow, whole):
    out, _ = whole
    before = contents(out)
    for flags, named in (
        (("--seed", 7), "seed 6 (got 7)"),
        (("--twist-map.deadzone", 0.1), "twist_map.deadzone 0.05 (got 0.1)"),
        (("--operator", "scripted"), "operator emulated (got scripted)"),
        (("--profiles", "steady"), "profiles [] (got ['steady'])"),
    ):
        ran = wrenchflow("collect", out, "--episodes", 5, *FLAGS, *flags, "--resume")
        assert ran.code == 1
        assert ran.stderr == (
            f"wrenchflow: '{out}' was begun with {named}: --resume goes on with the same configuration.\n"
        )
    assert contents(out) == before


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (
            ("--episodes", 2, "--resume"),
            "counted from 0: expected --episodes 4 at least, got 2.",
        ),
        (("--episodes", 5, "--resume", "--overwrite"), "pass one of them."),
        (
            ("--episodes", 5),
            "Choose another place, pass --resume to go on with it, or pass --overwrite.",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(wrenchflow, whole, flags, said):
    out, _ = whole
    before = contents(out)
    ran = wrenchflow("collect", out, *FLAGS, *flags)
    assert ran.code == 1
    assert said in ran.stderr
    assert contents(out) == before


def test_two_that_could_be_gone_on_with_are_one_too_many(tmp_path, unchecked, whole):
    out, _ = whole
    shutil.copytree(out, tmp_path / "raw")
    (tmp_path / "raw.partial").mkdir()
    from wrenchflow.collect.config import CollectConfig

    config = CollectConfig(episodes=5, tare_s=0.4, operator="emulated", seed=6)
    with pytest.raises(OutputError, match="both '"):
        list(collect_folder(tmp_path / "raw", config, resume=True))
    (tmp_path / "raw" / "manifest.json").unlink()
    with pytest.raises(OutputError, match="does not say what it was recorded with"):
        list(collect_folder(tmp_path / "raw", config, resume=True))


def test_what_is_set_aside_never_takes_the_place_of_another(tmp_path):
    for number in (1, 2, 3):
        (tmp_path / "a-0001.mcap").write_text(str(number))
        assert set_aside(tmp_path / "a-0001.mcap").read_text() == str(number)
    kept = {path.name: path.read_text() for path in (tmp_path / "discarded").iterdir()}
    assert kept == {"a-0001-1.mcap": "1", "a-0001-2.mcap": "2", "a-0001-3.mcap": "3"}
