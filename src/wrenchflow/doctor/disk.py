"""The disk that recordings go to: how fast it is, and for how long there is room."""

import os
import shutil
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from wrenchflow import signals
from wrenchflow.doctor.check import Check, bytes_said, seconds_said
from wrenchflow.episode import Episode, Stream
from wrenchflow.errors import WrenchflowError
from wrenchflow.recording.write import write_episode

_BLOCK_BYTES, _BLOCKS, _LIMIT_S = 256 * 1024, 40, 2.0
_SLOW_S = 0.5  # The writer syncs once a second, and the rings hold four.
_FEW_MINUTES = 30.0
# What `collect` records at 1 kHz.
_RECORDED = (
    *[signals.POSE] * 3,
    *[signals.JOINT_TORQUE] * 2,
    signals.JOINTS,
    signals.TWIST,
    signals.WRENCH,
    signals.IMPEDANCE,
    signals.REQUEST,
    signals.GOVERNOR,
)


def check_disk(folder: Path) -> Check:
    """Write to a folder, sync, and look at how much room there is.

    Args:
        folder: Where recordings would go.
    """
    name = "disk"
    try:
        with TemporaryDirectory(prefix=".wrenchflow-doctor-", dir=folder) as inner:
            synced_s = _write(Path(inner) / "blocks")
            bytes_s = _bytes_a_second(Path(inner))
        free = shutil.disk_usage(folder).free
    except (OSError, WrenchflowError) as error:
        why = (error.strerror or str(error)).lower() if isinstance(error, OSError) else str(error)
        return Check(
            name=name,
            state="missing",
            found=f"cannot write to '{folder}': {why}",
            means="Nothing can be recorded there.",
            todo="Choose another folder with --folder, make room, or change its rights.",
            essential=True,
        )
    p50, worst = float(np.median(synced_s)), float(synced_s.max())
    minutes = free / bytes_s / 60
    means = todo = ""
    if worst > _SLOW_S:
        means = "The writer falls behind while the disk is busy; the rings hold four seconds of the control loop."
        todo = "Record to a disk of this machine that nobody else writes to."
    elif minutes < _FEW_MINUTES:
        means, todo = "A recording that finds the disk full stays unfinished, and is recovered.", "Make room."
    return Check(
        name=name,
        state="warning" if means else "ok",
        found=f"write and fdatasync {seconds_said(p50)} (p50), {seconds_said(worst)} (max); {bytes_said(free)} free, "
        f"{_duration(minutes)} at {bytes_said(bytes_s)}/s without cameras or compression",
        means=means,
        todo=todo,
        essential=True,
        figures={
            "folder": str(folder.resolve()),
            "sync_p50_s": p50,
            "sync_max_s": worst,
            "free_bytes": free,
            "recording_bytes_s": bytes_s,
            "room_minutes": minutes,
        },
    )


def _write(path: Path) -> np.ndarray:
    """Times that blocks took to be on the disk [s]; a quarter of a second of recording is about a block."""
    block, taken_s = np.random.default_rng(0).bytes(_BLOCK_BYTES), []
    with path.open("wb", buffering=0) as file:
        begun_s = time.perf_counter()
        while len(taken_s) < _BLOCKS and time.perf_counter() - begun_s < _LIMIT_S:
            start_s = time.perf_counter()
            file.write(block)
            os.fdatasync(file.fileno())
            taken_s.append(time.perf_counter() - start_s)
    return np.array(taken_s)


def _bytes_a_second(folder: Path) -> float:
    """What a second of the control loop's streams takes without compression: the most that it can."""
    t = np.arange(1, 1001) * 1_000_000
    streams = {
        f"stream_{number}": Stream(t, np.zeros((len(t), signal.width)), signal, "base")
        for number, signal in enumerate(_RECORDED)
    }
    write_episode(folder / "second.mcap", Episode("second", "doctor", streams, (), {}), "none")
    return float((folder / "second.mcap").stat().st_size)


def _duration(minutes: float) -> str:
    return f"{minutes:.0f} minutes" if minutes < 600 else f"{minutes / 60:,.0f} hours"
