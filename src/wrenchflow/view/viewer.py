"""Rerun's viewer as a process: on the loopback only, and without a word to anybody else."""

import os
import re
import socket
import subprocess
import sys
import time
from importlib.resources import files
from pathlib import Path

import rerun_cli

from wrenchflow.errors import OutputError

HOST = "127.0.0.1"
# Without these Rerun would listen on all interfaces, and greet with pages that it fetches.
_FLAGS = ("--bind", HOST, "--hide-welcome-screen")
_START_S = 30.0
_LIVE_MEMORY = "2GiB"  # What is older than fits is forgotten.
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
    return environment | proxies | {"CI": "true", "RUST_LOG": "error"}


def require_display() -> None:
    """Refuse to open a window where there is no place for one.

    Raises:
        OutputError: If there is none.
    """
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise OutputError("there is no display to open a window on. --save OUT.rrd writes what it would show.")


def viewer_at(port: int) -> str:
    """The address of a viewer that listens on this port of the loopback; one is opened unless there is one already.

    It stays open, also when this process ends.

    Raises:
        OutputError: If there is no display, or the viewer does not begin to listen.
    """
    if not _listens(port):
        require_display()
        arguments = viewer_command("--port", str(port), "--memory-limit", _LIVE_MEMORY, "--expect-data-soon")
        nowhere = subprocess.DEVNULL
        # In a session of its own it does not hear the Ctrl-C that ends an episode.
        viewer = subprocess.Popen(
            arguments, env=viewer_environment(), stdin=nowhere, stdout=nowhere, stderr=nowhere, start_new_session=True
        )
        until_s = time.monotonic() + _START_S
        while not _listens(port):
            if viewer.poll() is not None:
                raise OutputError(f"Rerun's viewer ended with exit code {viewer.returncode} before it showed anything.")
            if time.monotonic() > until_s:
                viewer.terminate()
                raise OutputError(f"Rerun's viewer did not listen on {HOST}:{port} within {_START_S:g} s.")
            time.sleep(0.05)
    return f"rerun+http://{HOST}:{port}/proxy"


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(1.0)
        return probe.connect_ex((HOST, port)) == 0


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
