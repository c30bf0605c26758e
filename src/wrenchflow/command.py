"""What every command is: the flags that several share, exit codes, and how a stage is watched."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from tqdm import tqdm
from tyro.conf import Positional, arg

from wrenchflow.errors import ConfigError
from wrenchflow.told import result_lines

EXIT_DONE, EXIT_ERROR, EXIT_USAGE, EXIT_GATE, EXIT_INTERRUPTED, EXIT_TERMINATED = 0, 1, 2, 3, 130, 143

Overwrite = Annotated[bool, arg(help="Replace outputs that are there.")]
Jobs = Annotated[int, arg(help="Worker processes.")]
Cluster = Annotated[
    str | None,
    arg(
        name="executor",
        metavar="dask://HOST:PORT",
        help="A Dask cluster that does the work.",
    ),
]
Resume = Annotated[bool, arg(help="Go on with OUT, finished or interrupted; --episodes is how many it will hold.")]
Json = Annotated[bool, arg(help="Print one JSON object instead of text.")]
_OF_CONFIG = (
    "Values of the configuration, which the manifest records: of all flags below but those that say how a command is "
    "run (jobs, resume, review, viewer, sound, start)."
)
ConfigFile = Annotated[Path | None, arg(name="config", metavar="FILE.toml", help=_OF_CONFIG)]
Out = Annotated[Positional[Path], arg(metavar="OUT", help="Folder to write.")]
# A config's own fields are flags without a prefix, `--steps`; what is nested in it keeps one, `--policy.mlp.width`.
_UNPREFIXED = arg(name="")


def watch[T](stage: str, results: Iterator[T], total: int) -> list[T]:
    """Exhaust a stage's results behind a progress bar, where there is a terminal to draw it on."""
    return list(tqdm(results, desc=stage, total=total, disable=None, dynamic_ncols=True, leave=False))


@contextmanager
def needs(package: str, extra: str) -> Iterator[None]:
    """Import in this block what needs a package that not every installation has.

    Raises:
        ConfigError: If it is not installed; the message says how to.
    """
    try:
        yield
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != package:
            raise
        raise ConfigError(f"this needs {package}, which is not installed: install wrenchflow[{extra}].") from error


@dataclass(frozen=True, kw_only=True)
class Command(ABC):
    """What all commands share."""

    json: Json = False

    @abstractmethod
    def run(self) -> dict[str, Any]:
        """Do the work; returns plain figures."""

    def text(self, result: dict[str, Any]) -> list[str]:
        """The result as lines for a person."""
        return result_lines(result)

    def code(self, result: dict[str, Any]) -> int:
        """The exit code that a result stands for."""
        return EXIT_DONE

    def can_go_on(self, error: BaseException) -> bool:
        """Whether the same command with `--resume` goes on where an error ended it."""
        return False


@dataclass(frozen=True, kw_only=True)
class Stage(Command):
    """A command that writes OUT from what its config says.

    The command line reads `--config FILE` first and takes it out, for its values are the defaults of all other flags;
    the field is here so that a person finds it in `--help`.
    """

    overwrite: Overwrite = False
    config_file: ConfigFile = None


@dataclass(frozen=True, kw_only=True)
class Parallel(Stage):
    """A stage that works off one episode after the other, or several at once."""

    jobs: Jobs = 2
    cluster: Cluster = None
