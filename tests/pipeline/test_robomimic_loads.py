"""robomimic itself is the judge of our HDF5 file: its data set reads the values, and its own policy trains on them."""

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
import torch

from wrenchflow.datasets import robomimic as ours
from wrenchflow.datasets.about import About
from wrenchflow.datasets.config import ExportConfig
from wrenchflow.observation import OBSERVATIONS, Steps

pytestmark = [
    # What robomimic and those it is built on deprecate among themselves is not ours to mend.
    pytest.mark.filterwarnings("ignore::DeprecationWarning"),
    pytest.mark.filterwarnings("ignore::FutureWarning"),
    pytest.mark.filterwarnings("ignore::UserWarning"),
]

LENGTHS = (30, 22, 41)
KEYS = ("ee_pos", "ee_quat", "force_torque", "force_window", "goal_pos")


@pytest.fixture(scope="module")
def path(tmp_path_factory) -> Path:
    rng = np.random.default_rng(0)
    steps = [
        Steps(
            episode_id=f"{i:04d}",
            t=np.arange(n, dtype=np.int64) * 50_000_000,
            period_ns=50_000_000,
            observations={
                name: rng.normal(1.0, 5.0, (n, *shape)).astype(np.float32) for name, shape in OBSERVATIONS.items()
            },
            actions=rng.normal(0.0, 2.0, (n, 9)).astype(np.float32),
            success=True,
            task="peg-insertion",
        )
        for i, n in enumerate(LENGTHS)
    ]
    path = tmp_path_factory.mktemp("data") / "robomimic.hdf5"
    ours.write(path, steps, About(config=ExportConfig(valid_fraction=0.34, next_obs=True)))
    return path


def loaded(path: Path, mask: str | None = None):
    from robomimic.utils import obs_utils
    from robomimic.utils.dataset import SequenceDataset

    obs_utils.initialize_obs_utils_with_obs_specs({"obs": {"low_dim": list(KEYS)}})
    return SequenceDataset(
        hdf5_path=str(path),
        obs_keys=KEYS,
        dataset_keys=("actions", "rewards", "dones"),
        frame_stack=2,
        seq_length=8,
        pad_seq_length=True,
        get_pad_mask=False,
        hdf5_cache_mode="all",
        hdf5_use_swmr=False,
        load_next_obs=True,
        filter_by_attribute=mask,
    )


def test_its_windows_hold_what_the_file_holds(path):
    dataset = loaded(path)
    assert len(dataset) == sum(LENGTHS)
    with h5py.File(path) as file:
        demo = file["data/demo_1"]
        window = dataset[LENGTHS[0] + 5]  # Step 5 of demo_1: a frame of history, then the sequence.
        np.testing.assert_array_equal(window["actions"][1:], demo["actions"][5:13])
        for key in KEYS:
            np.testing.assert_array_equal(window["obs"][key][1:], demo["obs"][key][5:13])
            np.testing.assert_array_equal(window["next_obs"][key][1:], demo["next_obs"][key][5:13])
        assert np.abs(demo["actions"][:]).max() <= 1.0


def test_its_masks_split_the_episodes(path):
    train, valid = loaded(path, "train"), loaded(path, "valid")
    assert len(train) + len(valid) == sum(LENGTHS)
    assert set(train.demos).isdisjoint(valid.demos)


def test_its_behaviour_cloning_trains_on_force(path):
    from robomimic.algo import algo_factory
    from robomimic.config import config_factory
    from robomimic.utils import obs_utils

    config = config_factory("bc")
    with config.values_unlocked():
        config.observation.modalities.obs.low_dim = list(KEYS)
        config.train.batch_size = 16
    config.lock()
    obs_utils.initialize_obs_utils_with_config(config)
    dataset = loaded(path)
    shapes = {key: list(dataset[0]["obs"][key].shape[1:]) for key in KEYS}
    torch.manual_seed(0)
    model = algo_factory(algo_name="bc", config=config, obs_key_shapes=shapes, ac_dim=6, device=torch.device("cpu"))
    model.set_train()
    loader = torch.utils.data.DataLoader(dataset, batch_size=16)
    losses = []
    for epoch in range(15):
        for batch in loader:
            ready = model.process_batch_for_training(batch)
            info = model.train_on_batch(ready, epoch)
        losses.append(float(info["losses"]["action_loss"]))
    assert losses[-1] < 0.7 * losses[0]


def test_its_trainer_takes_the_configuration_beside_the_file(path, monkeypatch):
    from robomimic.algo import algo_factory
    from robomimic.config import config_factory
    from robomimic.utils import file_utils, obs_utils
    from robomimic.utils.dataset import SequenceDataset

    monkeypatch.chdir(path.parent)  # Where the configuration expects the file.
    wanted = json.loads((path.parent / "robomimic.train.json").read_text())
    config = config_factory(wanted["algo_name"])
    with config.values_unlocked():
        config.update(wanted)
        config.algo.rnn.hidden_dim = 20
        config.train.batch_size = 16
    config.lock()
    obs_utils.initialize_obs_utils_with_config(config)
    shapes = file_utils.get_shape_metadata_from_dataset(config.train.data, all_obs_keys=config.all_obs_keys)
    # As its trainer makes the data set, which itself cannot be imported without what renders.
    trained = SequenceDataset(
        hdf5_path=config.train.data,
        obs_keys=shapes["all_obs_keys"],
        dataset_keys=config.train.dataset_keys,
        load_next_obs=config.train.hdf5_load_next_obs,
        frame_stack=config.train.frame_stack,
        seq_length=config.train.seq_length,
        pad_seq_length=config.train.pad_seq_length,
        hdf5_cache_mode=config.train.hdf5_cache_mode,
        hdf5_use_swmr=config.train.hdf5_use_swmr,
        hdf5_normalize_obs=config.train.hdf5_normalize_obs,
        filter_by_attribute=config.train.hdf5_filter_key,
    )
    assert set(config.observation.modalities.obs.low_dim) >= {"force_torque", "force_window", "ee_pos", "goal_pos"}
    assert len(trained) == sum(LENGTHS) - LENGTHS[validation_index(path)]
    torch.manual_seed(0)
    device = torch.device("cpu")
    model = algo_factory(
        "bc", config=config, obs_key_shapes=shapes["all_shapes"], ac_dim=shapes["ac_dim"], device=device
    )
    loader = torch.utils.data.DataLoader(trained, batch_size=16)
    model.set_train()
    losses = []
    for epoch in range(8):
        for batch in loader:
            ready = model.process_batch_for_training(batch)
            ready = model.postprocess_batch_for_training(ready, None)
            losses.append(float(model.train_on_batch(ready, epoch)["losses"]["action_loss"]))
    assert np.mean(losses[-3:]) < losses[0]


def validation_index(path: Path) -> int:
    with h5py.File(path) as file:
        (held_out,) = file["mask/valid"][()]
    return int(held_out.decode().removeprefix("demo_"))


def test_its_tool_finds_the_environment_it_asks_for(path):
    from robomimic.utils import file_utils

    about = file_utils.get_env_metadata_from_dataset(str(path))
    assert about["env_name"] == "peg-insertion"
    with h5py.File(path) as file:
        assert json.loads(file["data"].attrs["env_args"]) == about
