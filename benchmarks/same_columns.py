"""Every column of one export in three formats, by their own readers: h5py, LeRobot itself, and zarr.

Run it as `python benchmarks/same_columns.py`; it collects six demonstrations, exports them and prints a line a column.
"""

import os

os.environ |= {"HF_HUB_OFFLINE": "1", "OMP_NUM_THREADS": "1"}

import tempfile
from pathlib import Path

import h5py
import numpy as np
import zarr
from lerobot.datasets.lerobot_dataset import LeRobotDataset

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.folder import collect_folder
from wrenchflow.datasets.config import ExportConfig
from wrenchflow.datasets.export import export_folder
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.pipeline import process_folder

STATE = ("ee_pos", "ee_quat", "tcp_twist", "joint_pos", "joint_vel", "force_torque", "force_torque_mean")


def exported(folder: Path) -> Path:
    """A folder with all three."""
    for _ in collect_folder(folder / "raw", CollectConfig(episodes=6, seed=5)):
        pass
    for _ in process_folder(folder / "raw", folder / "clean", ProcessConfig()):
        pass
    list(export_folder("robomimic,lerobot,zarr", folder / "clean", folder / "data", ExportConfig()))
    return folder / "data"


def of_hdf5(data: Path) -> dict[str, np.ndarray]:
    """Columns of all demos, one after the other."""
    with h5py.File(data / "robomimic.hdf5") as file:
        demos = [file[f"data/demo_{i}"] for i in range(len(file["data"]))]
        names = {**{f"obs/{name}": name for name in demos[0]["obs"]}, "actions_abs": "action", "t_ns": "time_ns"}
        found = {new: np.concatenate([demo[old][()] for demo in demos]) for old, new in names.items()}
        scale = file["data"].attrs["action_scale"]
        found["increment"] = np.concatenate([demo["actions"][()] for demo in demos]) * scale
        found["skew_ns"] = np.concatenate([demo["skew_ns"][()] for demo in demos])
        return found


def of_lerobot(data: Path) -> dict[str, np.ndarray]:
    """The same of LeRobot's own items."""
    dataset = LeRobotDataset("local/same", root=data / "lerobot")
    items = [dataset[i] for i in range(len(dataset))]

    def column(name: str) -> np.ndarray:
        return np.stack([item[name].numpy() for item in items])

    widths = {"ee_quat": 4, "joint_pos": 7, "joint_vel": 7, "ee_pos": 3}
    stops = np.cumsum([widths.get(name, 6) for name in STATE])[:-1]
    found = dict(zip(STATE, np.split(column("observation.state"), stops, axis=1), strict=True))
    environment = column("observation.environment_state")
    found |= {"goal_pos": environment[:, :3], "goal_quat": environment[:, 3:]}
    found |= {"force_window": column("observation.wrench_window"), "action": column("action")}
    found |= {"increment": column("target_increment"), "skew_ns": column("sync_skew_ns")}
    return found | {"time_ns": column("observation.time_ns").ravel()}


def of_zarr(data: Path) -> dict[str, np.ndarray]:
    """The same of the replay buffer."""
    root = zarr.open_group(str(data / "replay_buffer.zarr"), mode="r")["data"]
    names = {"action_increment": "increment", "sync_skew_ns": "skew_ns"}
    return {names.get(name, name): array[:] for name, array in root.arrays()}


def main() -> None:
    """Print how each column compares."""
    with tempfile.TemporaryDirectory() as folder:
        data = exported(Path(folder))
        ours, lerobot, buffer = of_hdf5(data), of_lerobot(data), of_zarr(data)
    print(f"{'column':<18} {'shape':<16} lerobot    zarr")
    for name, values in sorted(ours.items()):
        same = ["equal" if np.array_equal(values, other[name]) else "DIFFERS" for other in (lerobot, buffer)]
        print(f"{name:<18} {values.shape!s:<16} {same[0]:<10} {same[1]}")


if __name__ == "__main__":
    main()
