"""Which kind of data set is at a path."""

import os
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from wrenchflow.datasets.analysis import droid
from wrenchflow.datasets.analysis.droid import DroidTree
from wrenchflow.datasets.analysis.lerobot_folder import LeRobotFolder
from wrenchflow.datasets.analysis.recordings import RecordingFolder
from wrenchflow.datasets.analysis.robomimic_file import RobomimicFile
from wrenchflow.datasets.analysis.source import Source
from wrenchflow.datasets.load import LEROBOT_NAME, ROBOMIMIC_NAME
from wrenchflow.errors import DatasetError

_KINDS = "recordings (*.mcap), a robomimic .hdf5 file, a LeRobotDataset v3.0 folder, or a DROID tree (trajectory.h5)"


def open_source(path: Path) -> Source:
    """What reads the data set at a path.

    Raises:
        DatasetError: If there is nothing of a known kind.
    """
    if not path.exists():
        raise DatasetError(f"'{path}' does not exist. Expected {_KINDS}.")
    if path.is_file():
        if path.name == droid.NAME:
            return DroidTree(root=path.parent)
        if path.suffix in (".hdf5", ".h5"):
            return RobomimicFile(path=path)
        raise DatasetError(f"'{path}' is a file of no known kind. Expected {_KINDS}.")
    if (path / "meta" / "info.json").exists():
        return LeRobotFolder(root=path)
    if any(path.glob("*.mcap")):
        return RecordingFolder(root=path)
    if (path / ROBOMIMIC_NAME).exists():
        return RobomimicFile(path=path / ROBOMIMIC_NAME)
    if (path / LEROBOT_NAME / "meta" / "info.json").exists():
        return LeRobotFolder(root=path / LEROBOT_NAME)
    files = list(path.glob("*.hdf5"))
    if len(files) == 1:
        return RobomimicFile(path=files[0])
    if next(_trajectories(path), None) is not None:
        return DroidTree(root=path)
    found = ", ".join(sorted(entry.name for entry in islice(path.iterdir(), 5))) or "nothing"
    raise DatasetError(f"'{path}' holds no data set that is known here: got {found}. Expected {_KINDS}.")


def _trajectories(path: Path) -> Iterator[str]:
    """Folders of DROID episodes; the first is found without walking all."""
    return (folder for folder, _, files in os.walk(path) if droid.NAME in files)
