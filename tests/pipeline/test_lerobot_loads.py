"""LeRobot itself, offline, is the judge of our LeRobotDataset: it loads it, and its diffusion policy trains on it."""

import json
from pathlib import Path

import numpy as np
import pytest

from wrenchflow.datasets import lerobot
from wrenchflow.datasets.about import About
from wrenchflow.datasets.increments import increments
from wrenchflow.observation import OBSERVATIONS, Steps

pytestmark = [
    # What lerobot and those it is built on deprecate among themselves is not ours to mend.
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::FutureWarning"),
    pytest.mark.filterwarnings("ignore::UserWarning"),
]

LENGTHS = (30, 22, 41)


@pytest.fixture(scope="module", autouse=True)
def _offline(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HF_HUB_OFFLINE", "1")
        home = tmp_path_factory.mktemp("huggingface")
        patch.setenv("HF_HOME", str(home))
        patch.setenv("HF_LEROBOT_HOME", str(home / "lerobot"))
        patch.setenv("HF_DATASETS_CACHE", str(home / "datasets"))
        yield


@pytest.fixture(scope="module")
def steps() -> list[Steps]:
    rng = np.random.default_rng(0)
    return [
        Steps(
            episode_id=f"{i:04d}",
            t=1_700_000_000_000_000_007 + np.arange(n, dtype=np.int64) * 50_000_000,
            period_ns=50_000_000,
            observations={
                name: rng.normal(1.0, 5.0, (n, *shape)).astype(np.float32) for name, shape in OBSERVATIONS.items()
            },
            actions=rng.normal(0.0, 2.0, (n, 9)).astype(np.float32),
            success=True,
            task="peg-insertion",
            skew_ns={"wrench": rng.integers(0, 9, n)},
            valid={"wrench": rng.random(n) < 0.9},
        )
        for i, n in enumerate(LENGTHS)
    ]


@pytest.fixture(scope="module")
def folder(steps, tmp_path_factory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lerobot.layout, "FILE_MB", 0.09)  # So that the episodes take more than one file.
        path = tmp_path_factory.mktemp("data") / "lerobot"
        lerobot.write(path, steps, About())
    assert len(list((path / "data").rglob("*.parquet"))) > 1
    return path


@pytest.fixture(scope="module")
def dataset(folder):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    return LeRobotDataset("local/peg", root=folder)


def state_of(one: Steps) -> np.ndarray:
    o = one.observations
    pose = o["tcp_pose"][:, [0, 1, 2, 4, 5, 6, 3]]
    return np.hstack(
        [pose, o["tcp_twist"], o["joint_position"], o["joint_velocity"], o["wrench"], o["wrench_mean"]],
    )


def pose_of(one: Steps) -> np.ndarray:
    return one.observations["tcp_pose"]


def test_lerobot_loads_every_item_bit_for_bit(dataset, steps):
    assert (len(dataset), dataset.num_episodes, dataset.fps) == (sum(LENGTHS), len(LENGTHS), 20)
    items = iter(range(len(dataset)))
    for episode, one in enumerate(steps):
        state = state_of(one)
        goal = one.observations["goal_pose"][:, [0, 1, 2, 4, 5, 6, 3]]
        for k in range(len(one)):
            item = dataset[next(items)]
            assert item["observation.state"].numpy().tobytes() == state[k].tobytes()
            assert item["observation.environment_state"].numpy().tobytes() == goal[k].tobytes()
            assert item["observation.wrench_window"].numpy().tobytes() == one.observations["wrench_window"][k].tobytes()
            assert item["observation.wrench_window"].shape == (50, 6)
            assert item["action"].numpy().tobytes() == one.actions[k].tobytes()
            assert int(item["observation.time_ns"]) == one.t[k]
            assert item["target_increment"].numpy().tobytes() == increments(pose_of(one), one.actions)[k].tobytes()
            assert int(item["sync_skew_ns"]) == one.skew_ns["wrench"][k]
            assert bool(item["sync_valid"]) == one.valid["wrench"][k]
            assert (int(item["episode_index"]), int(item["frame_index"])) == (episode, k)
            assert item["timestamp"].item() == pytest.approx(k / 20)
            assert item["task"] == "peg-insertion"


def test_windows_of_time_stay_in_their_episode(folder, steps):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    dataset = LeRobotDataset("local/peg", root=folder, delta_timestamps={"action": [0.0, 0.05, 0.1]})
    item = dataset[LENGTHS[0] - 2]
    np.testing.assert_array_equal(item["action"].numpy(), steps[0].actions[[-2, -1, -1]])
    assert item["action_is_pad"].tolist() == [False, False, True]


def test_statistics_are_exact_and_of_the_shapes_that_lerobot_computes(dataset, folder, steps):
    from lerobot.datasets.compute_stats import compute_episode_stats

    everything = np.concatenate([state_of(one) for one in steps]).astype(np.float64)
    stats = dataset.meta.stats
    np.testing.assert_allclose(stats["observation.state"]["mean"], everything.mean(0), rtol=1e-12)
    np.testing.assert_allclose(stats["observation.state"]["std"], everything.std(0), rtol=1e-12)
    np.testing.assert_allclose(stats["observation.state"]["q99"], np.quantile(everything, 0.99, axis=0), rtol=1e-12)
    assert stats["observation.time_ns"]["max"].tolist() == [int(max(one.t[-1] for one in steps))]
    one = steps[0]
    theirs = compute_episode_stats(
        {
            "observation.state": state_of(one),
            "observation.wrench_window": one.observations["wrench_window"],
            "observation.time_ns": one.t,
            "action": one.actions,
        },
        dataset.meta.features,
    )
    rows = {row["episode_index"]: row for row in read_parquet(folder / "meta/episodes/chunk-000/file-000.parquet")}
    for feature, of in theirs.items():
        for name, value in of.items():
            ours = np.array(rows[0][f"stats/{feature}/{name}"])
            assert ours.shape == value.shape, (feature, name)
            assert np.shape(stats[feature][name]) == value.shape, (feature, name)
            if not name.startswith("q") and feature != "observation.time_ns":
                np.testing.assert_allclose(ours, value, rtol=1e-5, atol=1e-6)


def read_parquet(path: Path) -> list[dict]:
    import pyarrow.parquet as pq

    return pq.read_table(path).to_pylist()


def test_info_has_the_keys_of_lerobots_own(dataset, folder, tmp_path):
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    ours = json.loads((folder / "meta" / "info.json").read_text())
    features = {k: v for k, v in ours["features"].items() if k.startswith(("observation", "action"))}
    theirs = LeRobotDataset.create("local/other", fps=20, features=features, root=tmp_path / "other", use_videos=False)
    created = json.loads((theirs.root / "meta" / "info.json").read_text())
    assert list(ours) == list(created)
    for name, feature in created["features"].items():
        assert {key: feature[key] for key in ("dtype", "shape", "names")} == ours["features"][name]


def test_its_diffusion_policy_takes_training_steps_and_learns(dataset, folder):
    import torch
    from lerobot.configs.types import FeatureType
    from lerobot.datasets.lerobot_dataset import LeRobotDataset
    from lerobot.policies.diffusion.configuration_diffusion import DiffusionConfig
    from lerobot.policies.diffusion.modeling_diffusion import DiffusionPolicy
    from lerobot.policies.factory import make_pre_post_processors
    from lerobot.utils.feature_utils import dataset_to_policy_features

    torch.manual_seed(0)
    features = dataset_to_policy_features(dataset.meta.features)
    config = DiffusionConfig(
        input_features={name: f for name, f in features.items() if f.type is not FeatureType.ACTION},
        output_features={name: f for name, f in features.items() if f.type is FeatureType.ACTION},
        n_obs_steps=2,
        horizon=8,
        n_action_steps=4,
        drop_n_last_frames=3,
        down_dims=(16, 32),
        n_groups=4,
        diffusion_step_embed_dim=16,
        device="cpu",
        push_to_hub=False,
    )
    policy = DiffusionPolicy(config)
    before, _ = make_pre_post_processors(config, dataset_stats=dataset.meta.stats)
    offsets = {"observation": config.observation_delta_indices, "action": config.action_delta_indices}
    windows = LeRobotDataset(
        "local/peg",
        root=folder,
        delta_timestamps={
            name: [k / dataset.fps for k in offsets[name.partition(".")[0]]]
            for name in ("observation.state", "observation.environment_state", "action")
        },
    )
    loader = torch.utils.data.DataLoader(windows, batch_size=16, shuffle=True)
    optimizer = torch.optim.Adam(policy.parameters(), 3e-3)
    losses = []
    policy.train()
    for _ in range(4):
        for batch in loader:
            loss, _ = policy.forward(before(batch))
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            losses.append(loss.item())
    assert np.isfinite(losses).all()
    assert np.mean(losses[-4:]) < 0.9 * losses[0]
