"""The one error hierarchy: a known error is one line that says what, got, expected, and what is available."""

from collections.abc import Iterable
from difflib import get_close_matches


class WrenchflowError(Exception):
    """Anything that wrenchflow knows how to explain to a person in one line."""

    def __str__(self) -> str:
        """That line. Names that come out of a damaged file may hold anything; what cannot be shown is escaped."""
        text = super().__str__()
        return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class StreamError(WrenchflowError):
    """A stream, an event or an episode that breaks its own rules, or is not there."""


class ConfigError(WrenchflowError):
    """A configuration that cannot be read, or that names what does not exist."""


class RecordingError(WrenchflowError):
    """A file that is missing, truncated, or not what it says it is."""


class OutputError(WrenchflowError):
    """A place to write to that is taken, or cannot be written."""


class CalibrationError(WrenchflowError):
    """A calibration that the data cannot support."""


class DatasetError(WrenchflowError):
    """A data set that is missing, inconsistent, or of another layout."""


class CheckpointError(WrenchflowError):
    """A checkpoint that is missing, damaged, or made for other data."""


class ControlError(WrenchflowError):
    """A robot, a simulation or a request that control cannot go on with."""


class StartupError(ControlError):
    """An arm that is not fit to be started: what a check at the start found."""


class CameraError(WrenchflowError):
    """A camera that is not there, or gives what it should not."""


class DeviceError(WrenchflowError):
    """A device to move the arm with that is not there, may not be read, or has gone."""


class WorkerError(WrenchflowError):
    """Workers of a cluster that are gone."""


class Terminated(KeyboardInterrupt):
    """Somebody asked this process to end (SIGTERM): what Ctrl-C winds up is wound up, and what is known is written."""


def unknown(what: str, got: str, available: Iterable[str]) -> str:
    """Word the message for a name that does not exist, with the nearest one that does.

    Args:
        what: The kind of thing that was asked for, such as `task`.
        got: The name that was given.
        available: The names that exist.

    Returns:
        One line that ends with all available names.
    """
    names = sorted(available)
    near = get_close_matches(got, names, n=1)
    hint = f" Did you mean '{near[0]}'?" if near else ""
    return f"unknown {what} '{got}'.{hint} Available: {', '.join(names) or 'none'}."
