"""Which data sets are at a path, and what is wrong with them."""

from pathlib import Path

from wrenchflow.datasets.load import LEROBOT_NAME, ROBOMIMIC_NAME
from wrenchflow.datasets.validation import lerobot_rules, replay_rules, robomimic_rules
from wrenchflow.datasets.validation.problems import Problems
from wrenchflow.errors import DatasetError

REPLAY_NAME = "replay_buffer.zarr"
_KINDS = "a robomimic .hdf5 file, a LeRobot folder, a replay buffer (.zarr), or a folder with some of these"


def is_dataset(path: Path) -> bool:
    """Whether a path is for `check` and not a recording."""
    whole = path.with_name(path.name.removesuffix(".partial"))
    return path.is_dir() or whole.suffix in (".hdf5", ".h5", ".zarr")


def check(path: Path) -> list[Problems]:
    """What is wrong with each data set at a path.

    Args:
        path: A data set, or a folder that `export` wrote some into. One that is half written is never valid.

    Raises:
        DatasetError: If there is none, or one cannot be read at all.
    """
    if not path.exists():
        raise DatasetError(f"'{path}' does not exist. Expected {_KINDS}.")
    places = [path] if _kind(path) or _is_partial(path) or path.is_file() else sorted(path.iterdir())
    found = [_one(place) for place in places if _is(place)]
    if not found:
        there = ", ".join(sorted(entry.name for entry in path.iterdir())) if path.is_dir() else path.name
        raise DatasetError(
            f"'{path}' holds no data set that is known here: got {there or 'nothing'}. Expected {_KINDS}."
        )
    return found


def _is_partial(path: Path) -> bool:
    return path.name.endswith(".partial")


def _is(path: Path) -> bool:
    whole = path.with_name(path.name.removesuffix(".partial"))
    named = whole.name in (LEROBOT_NAME, ROBOMIMIC_NAME, REPLAY_NAME)
    return bool(_kind(path)) or (_is_partial(path) and (named or whole.suffix in (".hdf5", ".h5", ".zarr")))


def _kind(path: Path) -> str:
    if path.is_file():
        return "robomimic" if path.suffix in (".hdf5", ".h5") else ""
    if (path / "meta" / "info.json").exists():
        return "lerobot"
    return "replay" if (path / ".zgroup").exists() else ""


def _one(path: Path) -> Problems:
    if _is_partial(path):
        problems = Problems(file=path.name)
        problems.add("half-written", "was not finished: export it anew")
        return problems
    rules = {"robomimic": robomimic_rules.check, "lerobot": lerobot_rules.check, "replay": replay_rules.check}
    return rules[_kind(path)](path)
