"""Steps from a data set of either format, told apart by what is there."""

from pathlib import Path

from wrenchflow.datasets import lerobot_reader, robomimic_reader
from wrenchflow.errors import DatasetError
from wrenchflow.observation import Steps

ROBOMIMIC_NAME = "robomimic.hdf5"
LEROBOT_NAME = "lerobot"


def load_steps(path: Path) -> list[Steps]:
    """Read a data set that wrenchflow exported.

    Args:
        path: A robomimic .hdf5 file, a LeRobot folder, or the folder that `export` wrote either of them into; of two
            the robomimic file is read, for they hold the same steps.

    Raises:
        DatasetError: If there is no such data set, or it cannot be read.
    """
    if path.is_file():
        return robomimic_reader.read(path)
    if (path / ROBOMIMIC_NAME).is_file():
        return robomimic_reader.read(path / ROBOMIMIC_NAME)
    for folder in (path, path / LEROBOT_NAME):
        if (folder / "meta" / "info.json").is_file():
            return lerobot_reader.read(folder)
    if not path.is_dir():
        raise DatasetError(f"data set '{path}' does not exist.")
    found = ", ".join(sorted(entry.name for entry in path.iterdir())) or "nothing"
    raise DatasetError(
        f"'{path}' holds no data set: expected {ROBOMIMIC_NAME}, {LEROBOT_NAME}/ or meta/info.json, got {found}."
    )
