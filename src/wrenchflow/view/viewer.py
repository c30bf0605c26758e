"""Rerun's viewer as a process: on the loopback only, and without a word to anybody else."""

import os
import re
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import rerun_cli

from wrenchflow.errors import OutputError

HOST = "127.0.0.1"
# Without these Rerun would listen on all interfaces, and greet with pages that it fetches.
_FLAGS = ("--bind", HOST, "--hide-welcome-screen")
_PROXIES = ("ALL_PROXY", "HTTP_PROXY", "HTTPS_PROXY")
_NOBODY = f"http://{HOST}:9"  # The port of the discard protocol, which is served nowhere any more.
_OVERRIDDEN = {*_PROXIES, "NO_PROXY", "FORCE_RERUN_ANALYTICS"}


def viewer_command(*arguments: str) -> list[str]:
    """The viewer that came with the package, by its full path: what is on PATH may be another version.

    Raises:
        OutputError: If it is not there.
    """
    folder = Path(str(files(rerun_cli)))
    bundled = folder / "Rerun.app" / "Contents" / "MacOS" / "Rerun"
    program = bundled if bundled.exists() else folder / ("rerun.exe" if sys.platform == "win32" else "rerun")
    if not program.exists():
        raise OutputError(f"this rerun-sdk comes without a viewer: there is no {program}.")
    return [str(program), *_FLAGS, *arguments]


def viewer_environment() -> dict[str, str]:
    """The environment of a viewer that sends nothing to anybody.

    `CI` is what Rerun takes for a wish to keep its analytics to itself. It has no flag for its question whether there
    is a newer version; a proxy that nobody serves answers that.
    """
    environment = {name: value for name, value in os.environ.items() if name.upper() not in _OVERRIDDEN}
    proxies = {name: _NOBODY for proxy in _PROXIES for name in (proxy, proxy.lower())}
    return environment | proxies | {"CI": "true"}


def require_display() -> None:
    """Refuse to open a window where there is no place for one.

    Raises:
        OutputError: If there is none.
    """
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise OutputError("there is no display to open a window on. --save OUT.rrd writes what it would show.")


def run_viewer(path: Path) -> None:
    """Open a file, and wait until the window is closed.

    Raises:
        OutputError: If the viewer ends with an error.
    """
    command = viewer_command("--port", "auto", str(path))
    viewer = subprocess.Popen(command, env=viewer_environment(), stderr=subprocess.PIPE, text=True, errors="replace")
    try:
        _, said = viewer.communicate()
    finally:
        if viewer.poll() is None:
            viewer.terminate()
            viewer.wait()
    if viewer.returncode:
        lines = [line for line in re.sub(r"\x1b\[[0-9;]*m", "", said).splitlines() if line.strip()]
        why = lines[-1].strip() if lines else f"exit code {viewer.returncode}"
        raise OutputError(f"Rerun's viewer ended with an error: {why}")
