"""LeRobot's own command trains on an export, as a user would type it, without any network."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
def test_lerobot_train_takes_twenty_steps_on_an_export(chain, tmp_path):
    out = tmp_path / "out"
    command = [
        str(Path(sys.executable).with_name("lerobot-train")),
        "--dataset.repo_id=local/x",
        f"--dataset.root={chain.folder / 'dataset' / 'lerobot'}",
        "--policy.type=diffusion",
        "--policy.device=cpu",
        "--policy.push_to_hub=false",
        "--policy.n_obs_steps=2",
        "--policy.horizon=16",
        "--policy.n_action_steps=8",
        "--policy.down_dims=[64,128,256]",
        "--policy.drop_n_last_frames=7",
        "--batch_size=16",
        "--num_workers=0",
        "--steps=20",
        f"--output_dir={out}",
        "--job_name=x",
        "--wandb.enable=false",
    ]
    offline = {"HF_HUB_OFFLINE": "1", "HF_HOME": str(tmp_path / "huggingface"), "OMP_NUM_THREADS": "1"}
    ran = subprocess.run(command, env={**os.environ, **offline}, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr[-2000:]
    (config,) = out.rglob("pretrained_model/config.json")
    inputs = json.loads(config.read_text())["input_features"]
    assert {"observation.state", "observation.environment_state"} <= set(inputs)
