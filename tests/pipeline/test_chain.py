"""The whole chain through the real command line, twice: it fits together, and a seed is every byte it leaves."""

import dataclasses
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode

COMMAND = Path(sys.executable).with_name("wrenchflow")


def files_in(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_each_stage_says_what_it_did(chain):
    said, at = chain.said, chain.folder
    assert said["collect"]["episodes"] == 6
    assert said["collect"]["samples"] == sum(len(read_episode(path)["tcp_pose"]) for path in at.glob("raw/*.mcap"))
    assert said["collect"]["successes"] == 6
    assert said["process"]["episodes"] == 6
    assert 1.0 < said["process"]["max_force_n"] < 40.0
    for format in ("robomimic", "lerobot"):
        assert said[format] == {**said["robomimic"], "out": str(at / "dataset")}
        assert said[format]["episodes"] == 6
        assert said[format]["left_out"] == {}
    assert said["train"]["steps"] == 300
    assert said["deploy"]["attempts"] == 3
    low, high = said["deploy"]["success_interval"]
    assert 0.0 <= low <= said["deploy"]["success_rate"] <= high <= 1.0


def test_each_stage_leaves_its_files_and_nothing_half_done(chain):
    at = chain.folder
    recordings = [path.name for path in sorted(at.glob("raw/*.mcap"))]
    assert len(recordings) == 6
    assert sorted(files_in(at / "raw")) == sorted([*recordings, "manifest.json"])
    assert sorted(files_in(at / "clean")) == sorted(
        [
            *recordings,
            *(f"episodes/{name.removesuffix('.mcap')}.html" for name in recordings),
            "episodes/plotly.min.js",
            "manifest.json",
            "quality.json",
            "quality.parquet",
            "report.html",
        ]
    )
    assert {"robomimic.hdf5", "robomimic.manifest.json", "lerobot.manifest.json"} <= set(files_in(at / "dataset"))
    assert {"manifest.json", "config.json", "policy.json", "weights.safetensors", "metrics.jsonl"} <= set(
        files_in(at / "run")
    )
    rollouts = files_in(at / "rollouts")
    described = ["evaluation.html", "evaluation.json", "manifest.json"]
    assert sorted(name for name in rollouts if not name.endswith(".mcap")) == described
    assert len(rollouts) == 6
    assert list(at.rglob("*.partial")) == []


@pytest.mark.parametrize(
    ("path", "kind"),
    [
        ("raw", "folder of collect"),
        ("clean", "folder of process"),
        ("dataset", "data set"),
        ("dataset/robomimic.hdf5", "data set"),
        ("dataset/lerobot", "data set"),
        ("run", "folder of train"),
        ("rollouts", "folder of deploy"),
        ("rollouts/evaluation.json", "evaluation"),
        (".", "folder of stages"),
    ],
)
def test_info_knows_everything_that_a_stage_leaves(chain, wrenchflow, path, kind):
    assert wrenchflow("info", chain.folder / path, "--json").result["kind"] == kind
    text = wrenchflow("info", chain.folder / path)
    assert text.code == 0
    assert kind in text.stdout.splitlines()[0]


def test_info_looks_into_a_run_and_into_folders_without_a_manifest(chain, wrenchflow, tmp_path):
    about = wrenchflow("info", chain.folder / "run", "--json").result["policy"]
    assert (about["updates"], about["rate_hz"], about["network"]) == (300, 20.0, "mlp")
    for name in ("policy.json", "weights.safetensors"):
        shutil.copy(chain.folder / "run" / name, tmp_path / name)
    copied = wrenchflow("info", tmp_path, "--json").result
    assert copied["kind"] == "run"
    assert copied["policy"]["weights"] == about["weights"]
    (tmp_path / "loose").mkdir()
    shutil.copy(min((chain.folder / "raw").glob("*.mcap")), tmp_path / "loose")
    assert wrenchflow("info", tmp_path / "loose", "--json").result["recordings"] == 1


@pytest.mark.parametrize("stage", ["raw", "clean", "rollouts"])
def test_info_says_what_a_recording_holds(chain, wrenchflow, stage):
    path = min((chain.folder / stage).glob("*.mcap"))
    about = wrenchflow("info", path, "--json").result
    assert (about["kind"], about["task"], about["id"]) == ("recording", "peg-insertion", path.stem)
    assert ("/wrench" in about["topics"]) == (stage == "clean")
    assert about["topics"]["/wrench_raw"]["rate_hz"] == 1000.0
    by = {"seed": 0} if stage == "rollouts" else {"operator": "scripted", "device": "emulated-spacemouse", "seed": 5}
    assert about["by"] == by


def test_a_recording_replays_to_its_own_bits(chain, wrenchflow):
    for stage in ("raw", "clean", "rollouts"):
        path = min((chain.folder / stage).glob("*.mcap"))
        replayed = wrenchflow("replay", path, "--json").result
        assert replayed.pop("ticks") == len(read_episode(path)["joint_command"])
        assert set(replayed.values()) == {0.0}


def test_a_recording_whose_torque_was_changed_does_not(chain, tmp_path, wrenchflow):
    episode = read_episode(min((chain.folder / "raw").glob("*.mcap")))
    command = episode["joint_command"]
    pushed = command.data.copy()
    pushed[1500, 1] += 1.0
    path = tmp_path / "pushed.mcap"
    write_episode(path, episode.with_stream("joint_command", dataclasses.replace(command, data=pushed)))
    assert wrenchflow("replay", path, "--json").result["tcp_divergence_m"] > 1e-7


def test_validate_and_recover_by_their_commands(chain, tmp_path, wrenchflow):
    path = tmp_path / "e.mcap.partial"
    whole = min((chain.folder / "raw").glob("*.mcap"))
    assert wrenchflow("validate", whole).stdout.startswith("valid\nstream ")
    path.write_bytes(whole.read_bytes()[:-4000])
    assert wrenchflow("validate", path).code == 1
    recovered = wrenchflow("recover", path, "--json").result
    assert recovered["out"] == str(tmp_path / "e.recovered.mcap")
    assert recovered["problems"]
    assert len(read_episode(tmp_path / "e.recovered.mcap")["tcp_pose"]) > 1000
    assert wrenchflow("recover", path).code == 1


def test_the_same_seed_gives_the_same_bytes_on_any_number_of_workers(chain, wrenchflow, tmp_path):
    at = tmp_path
    commands = [
        ("collect", at / "raw", "--episodes", 6, "--seed", 5),
        ("process", at / "raw", at / "clean"),
        ("export", "robomimic", at / "clean", at / "dataset"),
        ("export", "lerobot", at / "clean", at / "dataset"),
    ]
    for command in commands:
        assert wrenchflow(*command, "--jobs", 2).code == 0
    for stage in ("raw", "clean", "dataset"):
        first, second = files_in(chain.folder / stage), files_in(at / stage)
        assert sorted(first) == sorted(second)
        assert [name for name in first if first[name] != second[name]] == []


def test_another_seed_gives_other_episodes(chain, wrenchflow, tmp_path):
    assert wrenchflow("collect", tmp_path / "raw", "--episodes", 1, "--seed", 6, "--jobs", 1).code == 0
    other = next((tmp_path / "raw").glob("*.mcap"))
    assert other.name not in {path.name for path in (chain.folder / "raw").iterdir()}


@pytest.mark.slow
def test_the_same_seed_gives_the_same_rollouts_on_any_number_of_workers(chain, wrenchflow, tmp_path):
    out = tmp_path / "rollouts"
    assert wrenchflow("deploy", chain.folder / "run", out, "--episodes", 3, "--batch", 2, "--jobs", 2).code == 0
    assert files_in(out) == files_in(chain.folder / "rollouts")


def test_rollouts_are_raw_again_they_can_be_processed_and_exported(chain, wrenchflow, tmp_path):
    at = tmp_path
    assert wrenchflow("process", chain.folder / "rollouts", at / "clean", "--jobs", 1).code == 0
    exporting = ("export", "robomimic", at / "clean", at / "dataset", "--no-only-success", "--jobs", 1, "--json")
    assert wrenchflow(*exporting).result["episodes"] == 3


def test_a_config_file_gives_the_flags_values_and_a_flag_beats_it(chain, wrenchflow, tmp_path):
    (tmp_path / "train.toml").write_text("steps = 20\nseed = 3\n[policy.mlp]\nwidth = 16\nlayers = 1\n")
    at = (chain.folder / "dataset", tmp_path / "run")
    ran = wrenchflow("train", *at, "--config", tmp_path / "train.toml", "--steps", 10, "--threads", 1, "--json")
    assert ran.result["steps"] == 10
    assert wrenchflow("train", *at, f"--config={tmp_path / 'train.toml'}", "--steps", 10, "--overwrite").code == 0
    config = json.loads((tmp_path / "run" / "config.json").read_text())
    assert (config["steps"], config["seed"], config["policy"]["mlp"]["width"]) == (10, 3, 16)


def test_training_goes_on_from_another_run_and_says_which(chain, wrenchflow, tiny, tmp_path):
    on = ("train", chain.folder / "dataset", tmp_path / "run", "--start", chain.folder / "run", *tiny)
    assert wrenchflow(*on, "--steps", 10).code == 0
    manifest = json.loads((tmp_path / "run" / "manifest.json").read_text())
    assert {"robomimic.hdf5", "weights.safetensors"} <= set(manifest["inputs"])


def test_the_lerobot_data_set_trains_too(chain, wrenchflow, tiny, tmp_path):
    lerobot = chain.folder / "dataset" / "lerobot"
    assert wrenchflow("train", lerobot, tmp_path / "run", "--steps", 300, *tiny).code == 0
    # Both formats hold the same steps, so the same seed makes the same policy of either.
    for name in ("weights.safetensors", "policy.json"):
        assert (tmp_path / "run" / name).read_bytes() == (chain.folder / "run" / name).read_bytes()


@pytest.mark.parametrize("command", [[str(COMMAND)], [sys.executable, "-m", "wrenchflow"]])
def test_the_installed_command_does_the_same(chain, command):
    path = min((chain.folder / "clean").glob("*.mcap"))
    ran = subprocess.run([*command, "info", str(path), "--json"], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (0, "")
    assert json.loads(ran.stdout)["id"] == path.stem


def test_the_installed_command_collects(chain, tmp_path):
    command = [str(COMMAND), "collect", "raw", "--episodes", "1", "--seed", "5", "--jobs", "2", "--json"]
    ran = subprocess.run(command, capture_output=True, text=True, check=False, cwd=tmp_path)
    assert ran.returncode == 0
    assert re.fullmatch(r"1 of 1  peg-insertion-\w+-0000  scripted  \d\.\d s  success\n", ran.stderr)
    assert json.loads(ran.stdout)["episodes"] == 1
    path = next((tmp_path / "raw").glob("*.mcap"))
    # One episode or six, the first is the same; only the configuration that it carries says how many were asked for.
    first, same = read_episode(chain.folder / "raw" / path.name), read_episode(path)
    assert (first.streams, first.events) == (same.streams, same.events)
