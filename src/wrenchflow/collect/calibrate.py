"""A calibration from recordings, or from a motion of the simulated arm, into a TOML file."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from wrenchflow.calibration import Calibration, load_calibration, toml_of
from wrenchflow.episode import Episode
from wrenchflow.errors import CalibrationError, ConfigError, OutputError
from wrenchflow.manifest import partial_of, sha256_of
from wrenchflow.process.calibrate_config import CalibrateConfig
from wrenchflow.process.csv_rests import read_csv
from wrenchflow.process.identify import calibration_of, identify
from wrenchflow.recording.reader import read_episode
from wrenchflow.recording.write import write_episode
from wrenchflow.rig import Payload, Rig, load_rig, rig_of

_SIMULATED_RIG = "panda_peg"
_MASS_OFF, _COM_OFF_M = 0.3, 0.01  # How far a simulated truth may be from the rig.


def calibrate(
    out: Path, recordings: Sequence[Path], config: CalibrateConfig, *, date: str, overwrite: bool = False
) -> Calibration:
    """Identify what hangs below a sensor, and write it down.

    Args:
        out: The TOML file. A motion in simulation is recorded beside it, as `.mcap`.
        recordings: `.mcap` or `.csv` files of an arm that rests in several orientations; without any, the simulated
            arm goes through the calibration motion.
        config: With which rig, and what is accepted.
        date: Today, as in 2025-12-31.
        overwrite: Replace a calibration that is there.

    Raises:
        OutputError: If `out` is taken, or is no .toml file.
        CalibrationError: If it is refused; nothing is written then but the recording of a simulated motion.
        WrenchflowError: If a recording or the rig cannot be read.
    """
    made = [] if recordings else [out.with_suffix(".mcap")]
    _require_free(out, [*recordings], made, overwrite=overwrite)
    if recordings:
        episodes = [read_csv(path) if path.suffix.lower() == ".csv" else read_episode(path) for path in recordings]
        rig = _rig_of_all(episodes, recordings, config)
    else:
        rig = load_rig(config.rig or _SIMULATED_RIG)
        episodes, recordings = [_simulated(rig, config)], made
        out.parent.mkdir(parents=True, exist_ok=True)
        write_episode(made[0], episodes[0])
    sources = [(path.name, sha256_of(path)) for path in recordings]
    if len({sha256 for _, sha256 in sources}) < len(sources):
        raise CalibrationError("one of the recordings is given twice: it would count as if it were two.")
    found = calibration_of(identify(episodes, rig, config), rig, sources, config.accept, date)
    _write(out, toml_of(found))
    return found


def simulated_truth(config: CalibrateConfig) -> Payload:
    """What really hangs below the simulated sensor."""
    rig = load_rig(config.rig or _SIMULATED_RIG)
    rng = np.random.default_rng((config.seed, 0))
    mass_kg = rig.payload.mass_kg * (1.0 + _MASS_OFF * rng.uniform(-1, 1))
    x, y, z = (np.array(rig.payload.com_sensor_m) + _COM_OFF_M * rng.uniform(-1, 1, 3)).tolist()
    return Payload(
        mass_kg=config.true_mass_kg or float(mass_kg),
        com_sensor_m=config.true_com_sensor_m or (x, y, z),
    )


def _simulated(rig: Rig, config: CalibrateConfig) -> Episode:
    # Only here, so that a machine without a simulator identifies from recordings.
    from wrenchflow.collect.calibration_motion import run_motion

    return run_motion(rig, simulated_truth(config), seed=config.seed, config=config.motion)


def _rig_of_all(episodes: Sequence[Episode], recordings: Sequence[Path], config: CalibrateConfig) -> Rig:
    """The rig that somebody named, or the one that all recordings carry."""
    if config.rig is not None:
        return load_rig(config.rig)
    rigs = []
    for episode, path in zip(episodes, recordings, strict=True):
        if "rig" not in episode.meta:
            raise ConfigError(f"'{path}' carries no rig, so its sensor mount is unknown: pass --rig.")
        rigs.append(rig_of(episode.meta, str(path)))
    for rig, path in zip(rigs, recordings, strict=True):
        if (rig.sensor, rig.T_flange_tcp) != (rigs[0].sensor, rigs[0].T_flange_tcp):
            raise CalibrationError(
                f"'{path}' is of another sensor or mount than '{recordings[0]}': calibrate them one by one."
            )
    return rigs[0]


def _require_free(out: Path, reads: Sequence[Path], made: Sequence[Path], *, overwrite: bool) -> None:
    if out.suffix != ".toml":
        raise OutputError(f"a calibration is a .toml file, got '{out}'.")
    if out.is_dir():
        raise OutputError(f"output '{out}' is a folder. Choose another place.")
    # What lies beside a calibration under its name is its motion; without one it is somebody else's.
    is_ours = overwrite and out.exists()
    for path in (out, *made):
        if path.exists() and not is_ours:
            raise OutputError(f"output '{path}' exists already. Choose another place, or pass --overwrite.")
        if path.resolve() in [read.resolve() for read in reads]:
            raise OutputError(f"output '{path}' would replace what is read. Choose another place.")
    if out.exists():
        try:
            load_calibration(out)
        except ConfigError as error:
            raise OutputError(f"output '{out}' is no calibration of ours, and stays: {error}") from error


def _write(out: Path, text: str) -> None:
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        partial = partial_of(out)
        partial.write_text(text, encoding="utf-8")
        os.replace(partial, out)
    except OSError as error:
        raise OutputError(f"output '{out}' cannot be written: {error.strerror}.") from error
