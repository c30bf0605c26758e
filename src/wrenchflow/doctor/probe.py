"""Tries what may crash, hang or load half a gigabyte: in a process of its own, with a limit on its time."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Answer:
    """What became of a process that tried something.

    Attributes:
        figures: The JSON object that it printed last; empty if it failed.
        failure: Why it failed, in a few words; empty if it did not.
    """

    figures: Mapping[str, Any] = field(default_factory=dict)
    failure: str = ""


def ask(arguments: Sequence[str], *, limit_s: float, environment: Mapping[str, str] | None = None) -> Answer:
    """Run this Python with some arguments and take the JSON object on the last line of its output.

    Args:
        arguments: Such as `-m` and a module.
        limit_s: It is killed, with all that it started, when it takes longer [s].
        environment: Variables besides our own.
    """
    process = subprocess.Popen(
        [sys.executable, *arguments],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        env={**os.environ, **(environment or {})},
        start_new_session=True,  # So that what it started can be ended with it.
    )
    try:
        stdout, stderr = process.communicate(timeout=limit_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        return Answer(failure=f"no answer within {limit_s:g} s")
    except BaseException:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        raise
    if process.returncode < 0:
        return Answer(failure=f"crashed ({signal.Signals(-process.returncode).name})")
    if process.returncode:
        said = [line for line in stderr.splitlines() if line.strip()]
        return Answer(failure=said[-1].strip() if said else f"exit code {process.returncode}")
    try:
        return Answer(json.loads(stdout.splitlines()[-1]))
    except (IndexError, ValueError):
        return Answer(failure=f"an answer that makes no sense: {stdout[-80:]!r}")
