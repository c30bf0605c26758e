"""The command line as a person meets it: arguments in, exit code and two streams of text out."""

import io
import json
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jaxtyping
import pytest

from wrenchflow import cli

# A network that trains in a second; what it learns does not matter.
TINY = ("--threads", "1", "--policy.mlp.width", "32", "--policy.mlp.layers", "1", "--batch-size", "64")


@dataclass(frozen=True, kw_only=True)
class Ran:
    """What came back from one command."""

    code: int
    stdout: str
    stderr: str

    @property
    def result(self) -> dict[str, Any]:
        """The one object on stdout; anything beside it makes this fail."""
        assert self.code == 0, self.stderr
        return json.loads(self.stdout)


@contextmanager
def without_shape_checks() -> Iterator[None]:
    """Without shape checks, which make a 1 kHz loop several times as long; the unit tests have them."""
    jaxtyping.config.update("jaxtyping_disable", True)
    try:
        yield
    finally:
        jaxtyping.config.update("jaxtyping_disable", False)


@pytest.fixture(scope="session")
def unchecked() -> Callable[[], AbstractContextManager[None]]:
    """A context without shape checks."""
    return without_shape_checks


@pytest.fixture(scope="session")
def wrenchflow() -> Callable[..., Ran]:
    """Run a command in this process, as `wrenchflow ARGUMENTS` would."""

    def run(*arguments: object) -> Ran:
        stdout, stderr = io.StringIO(), io.StringIO()
        with without_shape_checks(), redirect_stdout(stdout), redirect_stderr(stderr):
            code = cli.main([str(argument) for argument in arguments])
        return Ran(code=code, stdout=stdout.getvalue(), stderr=stderr.getvalue())

    return run


@dataclass(frozen=True, kw_only=True)
class Chain:
    """What one run of all stages left, and what each of them said."""

    folder: Path
    said: dict[str, dict[str, Any]]


@pytest.fixture(scope="session")
def tiny() -> tuple[str, ...]:
    """Flags of that network."""
    return TINY


@pytest.fixture(scope="session")
def chain(wrenchflow, tmp_path_factory) -> Chain:
    """Six demonstrations, processed, exported twice, learned from and deployed: every stage by its own command."""
    at = tmp_path_factory.mktemp("chain")
    stages = {
        "collect": ("collect", at / "raw", "--episodes", 6, "--seed", 5),
        "process": ("process", at / "raw", at / "clean"),
        "robomimic": ("export", "robomimic", at / "clean", at / "dataset"),
        "lerobot": ("export", "lerobot", at / "clean", at / "dataset"),
        "train": ("train", at / "dataset" / "robomimic.hdf5", at / "run", "--steps", 300, *TINY),
        "deploy": ("deploy", at / "run", at / "rollouts", "--episodes", 3, "--batch", 2),
    }
    with_jobs = {"collect", "process", "robomimic", "lerobot", "deploy"}
    said = {}
    for name, arguments in stages.items():
        ran = wrenchflow(*arguments, *(("--jobs", 1) if name in with_jobs else ()), "--json")
        lines = stages["collect"][3] if name == "collect" else 0  # One an episode, where nobody can see a board.
        assert ran.stderr.count("\n") == lines, name
        said[name] = ran.result
    return Chain(folder=at, said=said)
