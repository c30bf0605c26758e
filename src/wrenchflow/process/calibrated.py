"""A recording with the payload that a calibration found, in place of the one that its rig says."""

from pathlib import Path

from wrenchflow.calibration import calibrated, calibration_meta, load_calibration
from wrenchflow.config import to_mapping
from wrenchflow.episode import Episode
from wrenchflow.rig import rig_of


def with_calibration(episode: Episode, path: Path | None) -> Episode:
    """The episode with the calibrated payload in its rig, and all of the calibration beside it; without one, itself.

    Raises:
        CalibrationError: If it is of another sensor, or of one that was mounted otherwise.
        ConfigError: If the file or the rig cannot be read.
    """
    if path is None:
        return episode
    rig = calibrated(rig_of(episode.meta, "its metadata"), load_calibration(path))
    return episode.with_meta(rig=to_mapping(rig), **calibration_meta(path))
