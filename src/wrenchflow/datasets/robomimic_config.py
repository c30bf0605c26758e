"""A training configuration for robomimic that uses what our file has: every observation, force among them."""

from typing import Any

from wrenchflow.datasets.keys import keys_of
from wrenchflow.observation import Steps

_SEQUENCE = 10  # Steps that its recurrent network sees.


def training_config(file_name: str, first: Steps) -> dict[str, Any]:
    """A configuration of behaviour cloning with a recurrent network and a mixture of Gaussians, as plain values.

    What is not said stays as robomimic has it. Observations are not normalised: robomimic 0.3 cannot do so with more
    than one step (its check compares one step's shape with a sequence's), nor while it validates.

    Args:
        file_name: Of the data set; robomimic looks for it where it is started.
        first: An episode of it; all have its observations and cameras.
    """
    return {
        "algo_name": "bc",
        "experiment": {
            "name": "wrenchflow",
            "validate": True,
            "rollout": {"enabled": False},  # Its rollouts need an environment of robosuite's.
            "save": {"enabled": True, "every_n_epochs": 50, "on_best_rollout_success_rate": False},
        },
        "train": {
            "data": file_name,
            "output_dir": "~/robomimic_runs",  # A relative folder would be one within robomimic's own package.
            "hdf5_cache_mode": "all",
            "hdf5_load_next_obs": False,
            "hdf5_normalize_obs": False,
            "hdf5_filter_key": "train",
            "hdf5_validation_filter_key": "valid",
            "seq_length": _SEQUENCE,
            "batch_size": 100,
            "num_epochs": 500,
            "cuda": False,
        },
        "algo": {
            "rnn": {"enabled": True, "horizon": _SEQUENCE},
            "gmm": {"enabled": True},
        },
        "observation": {
            "modalities": {
                "obs": {
                    "low_dim": [key.name for key in keys_of(first.observations)],
                    "rgb": [f"{camera}_image" for camera in first.pictures],
                }
            }
        },
    }
