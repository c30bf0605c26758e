"""Save an episode as Rerun's own file, or open it in Rerun's viewer."""

import os
import tempfile
from pathlib import Path

import rerun as rr

from wrenchflow.episode import Episode
from wrenchflow.errors import OutputError
from wrenchflow.view.blueprint import make_blueprint
from wrenchflow.view.contents import Contents
from wrenchflow.view.log import log_episode
from wrenchflow.view.viewer import require_display, run_viewer

APPLICATION = "wrenchflow"


def save(episode: Episode, path: Path, *, overwrite: bool = False) -> None:
    """Write an episode and its blueprint as an `.rrd` file, which `rerun FILE` opens.

    Args:
        episode: What is shown.
        path: The file; it is `<path>.partial` until it is complete.
        overwrite: Replace a file that is there.

    Raises:
        OutputError: If the file is there, or cannot be written.
        RecordingError: If an image cannot be read.
    """
    if path.suffix != ".rrd":
        raise OutputError(f"Rerun opens files that end in .rrd, got '{path}'.")
    if path.exists() and not overwrite:
        raise OutputError(f"{path} exists already. --overwrite replaces it.")
    partial = path.with_name(path.name + ".partial")
    try:
        partial.open("wb").close()  # Rerun would only warn of a file that it cannot write.
        _write(episode, partial)
        os.replace(partial, path)
    except OSError as error:
        raise OutputError(f"cannot write {partial}: {(error.strerror or str(error)).lower()}.") from error


def show(episode: Episode) -> None:
    """Open an episode in Rerun's viewer, and wait until its window is closed.

    Raises:
        OutputError: If there is no display, or the viewer ends with an error.
        RecordingError: If an image cannot be read.
    """
    require_display()
    with tempfile.TemporaryDirectory(prefix="wrenchflow-view-") as folder:
        path = Path(folder) / f"{Path(episode.id).name or 'episode'}.rrd"
        _write(episode, path)
        run_viewer(path)


def _write(episode: Episode, path: Path) -> None:
    contents = Contents.of_episode(episode)
    recording = rr.RecordingStream(APPLICATION, send_properties=False)
    recording.save(path)
    recording.send_blueprint(make_blueprint(contents))
    log_episode(recording, episode, contents)
    recording.flush()
    recording.disconnect()
