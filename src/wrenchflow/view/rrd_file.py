"""An `.rrd` file that is `.partial` until it is complete."""

import os
from pathlib import Path

from wrenchflow.errors import OutputError


def begin_file(path: Path, *, overwrite: bool = False) -> Path:
    """Make sure that a file can be written; returns the name that it has until `finish_file`.

    Raises:
        OutputError: If it is there already, or cannot be written, or is not called `.rrd`.
    """
    if path.suffix != ".rrd":
        raise OutputError(f"Rerun opens files that end in .rrd, got '{path}'.")
    if path.exists() and not overwrite:
        raise OutputError(f"{path} exists already. --overwrite replaces it.")
    partial = _partial(path)
    try:
        partial.open("wb").close()  # Rerun itself would say so in its log, and go on.
    except OSError as error:
        raise _cannot_write(partial, error) from error
    return partial


def finish_file(path: Path) -> None:
    """Give a complete file its name.

    Raises:
        OutputError: If that is not possible.
    """
    try:
        os.replace(_partial(path), path)
    except OSError as error:
        raise _cannot_write(path, error) from error


def _partial(path: Path) -> Path:
    return path.with_name(path.name + ".partial")


def _cannot_write(path: Path, error: OSError) -> OutputError:
    return OutputError(f"cannot write {path}: {(error.strerror or str(error)).lower()}.")
