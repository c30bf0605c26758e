"""Python, what is installed, processors and memory."""

import os
import platform
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from wrenchflow import __version__
from wrenchflow.doctor.check import Check, State, bytes_said

# What everything stands on, as in the package's own list of dependencies.
_NEEDED = (
    "numpy",
    "scipy",
    "numba",
    "jaxtyping",
    "mcap",
    "lz4",
    "zstandard",
    "h5py",
    "pyarrow",
    "tyro",
    "tqdm",
    "plotly",
)
_ENOUGH_BYTES = 2 * 2**30


def installed(package: str) -> str | None:
    """Version of a package, without loading it; None where it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def check_python() -> Check:
    """Python and the packages that nothing works without."""
    versions = {name: installed(name) for name in _NEEDED}
    lacking = [name for name, found in versions.items() if found is None]
    python = platform.python_version()
    found = f"{python}, wrenchflow {__version__}, numpy {versions['numpy']}, numba {versions['numba']}"
    return Check(
        name="python",
        state="missing" if lacking else "ok",
        found=f"{python}, not installed: {', '.join(lacking)}" if lacking else f"{found}, mcap {versions['mcap']}",
        means="wrenchflow was installed without what it needs." if lacking else "",
        todo="Install it again, with its dependencies." if lacking else "",
        essential=True,
        figures={"python": python, "wrenchflow": __version__, **versions},
    )


def check_processors() -> Check:
    """Processor cores and memory that this process may use, a container's limits included."""
    cores = _cores(Path("/sys/fs/cgroup"))
    total, free = _memory(Path("/proc/meminfo"), Path("/sys/fs/cgroup"))
    state: State = "ok"
    means = todo = ""
    if cores < 2:
        state, means = "warning", "A recording's writer takes turns with the control loop on one core: ticks come late."
        todo = "Use two cores or more."
    elif free < _ENOUGH_BYTES:
        state, means = "warning", f"Training and processing want {bytes_said(_ENOUGH_BYTES)} or more."
        todo = "Close other programs, or raise the container's limit."
    return Check(
        name="processor, memory",
        state=state,
        found=f"{cores:g} cores, {bytes_said(free)} of {bytes_said(total)} memory free",
        means=means,
        todo=todo,
        figures={"cores": cores, "memory_bytes": total, "free_bytes": free},
    )


def _cores(cgroup: Path) -> float:
    """Cores that we may run on, or the share of them that a container has."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    quota, _, period_us = _text(cgroup / "cpu.max").partition(" ")
    return min(allowed, int(quota) / int(period_us)) if quota.isdigit() and period_us.isdigit() else allowed


def _memory(meminfo: Path, cgroup: Path) -> tuple[int, int]:
    """Memory in all, and what of it is free [bytes]."""
    lines = dict(line.split(":", 1) for line in _text(meminfo).splitlines() if ":" in line)
    total, free = (int(lines.get(key, "0 kB").split()[0]) * 1024 for key in ("MemTotal", "MemAvailable"))
    limit, used = _text(cgroup / "memory.max"), _text(cgroup / "memory.current")
    if limit.isdigit() and used.isdigit() and int(limit) < total:
        return int(limit), min(free, max(0, int(limit) - int(used)))
    return total, free


def check_governor(cpus: Path = Path("/sys/devices/system/cpu")) -> Check:
    """How the processor's frequency is chosen."""
    governors = sorted({_text(file) for file in cpus.glob("cpu[0-9]*/cpufreq/scaling_governor")} - {""})
    if not governors:
        return Check(
            name="processor frequency",
            state="missing",
            found="no governor to read here",
            means="Usual in a virtual machine or a container: the host decides how fast the processor runs.",
        )
    is_steady = governors == ["performance"]
    return Check(
        name="processor frequency",
        state="ok" if is_steady else "warning",
        found=f"governor {', '.join(governors)}",
        means="" if is_steady else "A processor that slows down between ticks answers the next one late.",
        todo="" if is_steady else "sudo cpupower frequency-set -g performance",
        figures={"governor": ", ".join(governors)},
    )


def _text(file: Path) -> str:
    """Content of a small file of the kernel's; empty where there is none."""
    try:
        return file.read_text().strip()
    except OSError:
        return ""
