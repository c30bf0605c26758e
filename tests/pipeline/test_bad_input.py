"""What goes wrong is told in one line, as golden/bad_input.toml has it, and leaves nothing that looks whole."""

import re
import shutil
import tomllib
from dataclasses import replace
from importlib import resources
from pathlib import Path

import h5py
import numpy as np
import pytest

from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode

GOLDEN = Path(__file__).parents[1] / "golden" / "bad_input.toml"
CASES = tomllib.loads(GOLDEN.read_text())


def cut(path: Path) -> None:
    """Keep the first half of a file, as a full disk or a pulled plug does."""
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])


@pytest.fixture(scope="module")
def bad(chain, tmp_path_factory) -> Path:
    """A folder with two good episodes, what came of them, and one of everything that can be wrong."""
    at = tmp_path_factory.mktemp("bad")
    for stage in ("raw", "clean"):
        (at / stage).mkdir()
        for number, path in enumerate(sorted((chain.folder / stage).glob("*.mcap"))[:2]):
            shutil.copy(path, at / stage / f"{number}.mcap")
    for stage in ("dataset", "run"):
        shutil.copytree(chain.folder / stage, at / stage)
    (at / "empty").mkdir()
    (at / "notes.txt").write_text("not ours")

    for name in ("truncated", "loaded", "not_mcap"):
        (at / name).mkdir()
    shutil.copy(at / "raw" / "0.mcap", at / "truncated" / "0.mcap")
    cut(at / "truncated" / "0.mcap")
    (at / "not_mcap" / "0.mcap").write_text("not a recording")
    # Somebody leans on the tool while it should rest.
    episode = read_episode(at / "raw" / "0.mcap")
    raw = episode["wrench_raw"]
    leant_on = raw.data + np.array([0.0, 0.0, 15.0, 0.0, 0.0, 0.0])
    write_episode(at / "loaded" / "0.mcap", episode.with_stream("wrench_raw", replace(raw, data=leant_on)))

    shutil.copy(at / "dataset" / "robomimic.hdf5", at / "truncated.hdf5")
    cut(at / "truncated.hdf5")
    with h5py.File(at / "other.hdf5", "w") as file:
        file["something"] = np.zeros(3)
    for name in ("cut_run", "unfit_run", "blind_run", "slow_run"):
        shutil.copytree(at / "run", at / name)
    cut(at / "cut_run" / "weights.safetensors")
    description = at / "unfit_run" / "policy.json"
    description.write_text(description.read_text().replace('"width": 32', '"width": 64'))
    description = at / "blind_run" / "policy.json"
    description.write_text(description.read_text().replace('"wrench_mean"', '"wrench_meen"'))
    description = at / "slow_run" / "policy.json"
    description.write_text(description.read_text().replace('"period_ns": 50000000', '"period_ns": 100000000'))

    (at / "unknown_key.toml").write_text("episods = 3\n")
    (at / "unknown_nested_key.toml").write_text("[policy.mlp]\nwidht = 3\n")
    (at / "jobs.toml").write_text("episodes = 3\njobs = 1\n")
    (at / "wrong_type.toml").write_text('episodes = "three"\n')
    (at / "wrong_value.toml").write_text('features = "with_feeling"\n')
    (at / "zip.toml").write_text('compression = "zip"\n')
    (at / "not.toml").write_text("episodes = = 3\n")
    package = resources.files("wrenchflow")
    panda = (package / "robots" / "panda.toml").read_text()
    (at / "limitless.toml").write_text(panda.replace("torque_nm = [87.0", "torque_nm = [nan"))
    peg = (package / "panda_peg.toml").read_text()
    for name in ("limitless.toml", "pandaa"):
        (at / f"rig_of_{name.removesuffix('.toml')}.toml").write_text(peg.replace('"panda"', f'"{name}"'))
    (at / "own_rig.toml").write_text('T_flange_tcp = [0, 0, 0.1, 1, 0, 0, 0]\n[robott]\nname = "x"\n')
    return at


def tree(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", CASES)
def test_bad_input_is_told_in_one_line_and_leaves_nothing_whole(bad, wrenchflow, monkeypatch, name):
    case, before = CASES[name], tree(bad)
    monkeypatch.chdir(bad)
    ran = wrenchflow(*case["arguments"].split())
    assert (ran.code, ran.stdout) == (1, "")
    assert re.fullmatch(re.escape(f"wrenchflow: {case['says']}\n").replace("<n>", r"\d[\d.]*"), ran.stderr), ran.stderr
    left = {path: content for path, content in tree(bad).items() if ".partial" not in path}
    assert left == before
    for partial in bad.glob("*.partial"):
        shutil.rmtree(partial) if partial.is_dir() else partial.unlink()


@pytest.mark.parametrize("jobs", [1, 2])
def test_bad_episodes_among_good_ones_are_told_and_the_gate_holds(bad, wrenchflow, tmp_path, jobs):
    raw, out = tmp_path / "raw", tmp_path / "clean"
    raw.mkdir()
    for number, source in enumerate(("raw/0", "raw/1", "loaded/0", "truncated/0", "not_mcap/0")):
        shutil.copy(bad / f"{source}.mcap", raw / f"{number}.mcap")
    ran = wrenchflow("process", raw, out, "--jobs", jobs, "--gate")
    assert (ran.code, ran.stderr) == (3, "")
    assert "defect: no-clean-force" in ran.stdout
    assert "the reading is loaded in the bias window" in ran.stdout
    assert "defect: unreadable in 3, 4" in ran.stdout
    assert sorted(path.name for path in out.glob("*.mcap")) == ["0.mcap", "1.mcap"]
    assert wrenchflow("process", raw, out, "--jobs", jobs, "--overwrite").code == 0


def test_what_is_there_is_replaced_when_told(bad, wrenchflow, tmp_path):
    out = tmp_path / "clean"
    for _ in range(2):
        assert wrenchflow("process", bad / "raw", out, "--jobs", 1, "--overwrite").code == 0
    assert wrenchflow("process", bad / "raw", out, "--jobs", 1).code == 1


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["colect", "out"],
        ["collect"],
        ["collect", "out", "--episods", "3"],
        ["collect", "out", "--episodes", "three"],
        ["train", "dataset", "out", "--features", "with_feeling"],
        ["deploy", "run"],
    ],
)
def test_a_usage_error_is_2(wrenchflow, monkeypatch, tmp_path, arguments):
    monkeypatch.chdir(tmp_path)
    ran = wrenchflow(*arguments)
    assert (ran.code, ran.stdout) == (2, "")
    assert ran.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("arguments", [["--help"], ["collect", "--help"], ["--version"]])
def test_help_and_version_are_no_errors(wrenchflow, arguments):
    ran = wrenchflow(*arguments)
    assert (ran.code, ran.stderr) == (0, "")
    assert ran.stdout
