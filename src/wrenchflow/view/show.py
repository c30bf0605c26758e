"""Save an episode as Rerun's own file, or open it in Rerun's viewer."""

import tempfile
from pathlib import Path

import rerun as rr

from wrenchflow.episode import Episode
from wrenchflow.errors import OutputError
from wrenchflow.view.blueprint import make_blueprint
from wrenchflow.view.contents import Contents
from wrenchflow.view.log import APPLICATION, log_episode
from wrenchflow.view.rrd_file import begin_file, finish_file
from wrenchflow.view.viewer import require_display, run_viewer


def save(episode: Episode, path: Path, *, overwrite: bool = False) -> None:
    """Write an episode and its blueprint as an `.rrd` file, which `rerun FILE` opens.

    Args:
        episode: What is shown.
        path: The file; it is `<path>.partial` until it is complete.
        overwrite: Replace a file that is there.

    Raises:
        OutputError: If the file is there, cannot be written, or is not called `.rrd`.
        RecordingError: If an image cannot be read.
    """
    _write(episode, begin_file(path, overwrite=overwrite))
    finish_file(path)


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
    try:
        recording.flush()
    except RuntimeError as error:
        raise OutputError(f"cannot write {path}: Rerun says {error}.") from error
    recording.disconnect()
