"""The command line: parse, dispatch, print, exit codes. The only place that prints."""

import json
import math
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import field, make_dataclass
from pathlib import Path
from typing import Any

import tyro

from wrenchflow import __version__
from wrenchflow.command import (
    EXIT_DONE,
    EXIT_ERROR,
    EXIT_INTERRUPTED,
    EXIT_TERMINATED,
    EXIT_USAGE,
    Command,
    Stage,
)
from wrenchflow.commands import COMMANDS
from wrenchflow.config import load, read_toml, to_mapping
from wrenchflow.errors import ConfigError, Terminated, WrenchflowError


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code: 0 done, 1 a known error, 2 usage, 130 interrupted, 143 terminated."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    command = None
    try:
        if arguments in (["--version"], ["-V"]):
            print(__version__)
            return EXIT_DONE
        command = _parse(arguments)
        _require_sound(command)
        result = command.run()
    except WrenchflowError as error:
        _complain(str(error), error, command, arguments)
        return EXIT_ERROR
    except Terminated as end:
        _complain("terminated.", end, command, arguments)
        return EXIT_TERMINATED
    except KeyboardInterrupt as end:
        _complain("interrupted.", end, command, arguments)
        return EXIT_INTERRUPTED
    except SystemExit as stop:  # tyro leaves so: after its help, or with its own word on a usage error.
        return EXIT_USAGE if stop.code else EXIT_DONE
    print(json.dumps(result) if command.json else "\n".join(command.text(result)))
    return command.code(result)


def _complain(what: str, error: BaseException, command: Command | None, arguments: Sequence[str]) -> None:
    """Say in one line what went wrong, what was noted on the way, where a black box is for one, and how to go on."""
    notes = [*getattr(error, "__notes__", ())]
    if command is not None and command.can_go_on(error):
        again = [argument for argument in arguments if argument not in ("--resume", "--overwrite")]
        notes.append(f"Go on with: {shlex.join(['wrenchflow', *again, '--resume'])}")
    print("wrenchflow:", what, *notes, file=sys.stderr)


def _parse(arguments: list[str]) -> Command:
    commands: dict[str, Callable[..., Command]] = dict(COMMANDS)
    rest, file = _without_config_file(arguments)
    if file is not None:
        commands[arguments[0]] = _with_defaults(arguments[0], file)
    return tyro.extras.subcommand_cli_from_dict(
        commands, prog="wrenchflow", description=_DESCRIPTION, args=rest, sort_subcommands=False
    )


def _without_config_file(arguments: list[str]) -> tuple[list[str], Path | None]:
    """Take `--config FILE` out: it gives the defaults that other flags change, so it is read before they are."""
    times = sum(argument.partition("=")[0] == "--config" for argument in arguments)
    if times > 1:
        raise ConfigError(f"--config is given {times} times, expected once.")
    for at, argument in enumerate(arguments):
        name, given, file = argument.partition("=")
        if name == "--config" and given:
            return arguments[:at] + arguments[at + 1 :], Path(file)
        if name == "--config" and {"--help", "-h"}.isdisjoint(arguments):
            if at + 1 == len(arguments):
                raise ConfigError("--config takes a TOML file, got nothing after it.")
            return arguments[:at] + arguments[at + 2 :], Path(arguments[at + 1])
    return arguments, None


def _require_sound(command: Command) -> None:
    """Refuse what no stage can work with, before any of them begins.

    Raises:
        ConfigError: For fewer than one worker, a negative seed, or a number that is not finite.
    """
    jobs = getattr(command, "jobs", 1)
    if jobs < 1:
        raise ConfigError(f"jobs is {jobs}, expected at least 1.")
    for name, value in _numbers(to_mapping(getattr(command, "config", None))):
        if not math.isfinite(value):
            raise ConfigError(f"{name} is {value}, expected a finite number.")
        if name == "seed" and not 0 <= value < 2**63:
            raise ConfigError(f"seed is {value}, expected from 0 to {2**63 - 1}.")


def _numbers(values: Any, name: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(values, Mapping):
        for key, value in values.items():
            yield from _numbers(value, f"{name}.{key}" if name else key)
    elif isinstance(values, int | float) and not isinstance(values, bool):
        yield name, values


def _with_defaults(name: str, file: Path) -> type[Command]:
    """A command whose config has the values of a TOML file as its defaults."""
    configurable = {known: kind for known, kind in COMMANDS.items() if issubclass(kind, Stage)}
    if name not in configurable:
        raise ConfigError(f"--config follows one of the commands {', '.join(configurable)}, got '{name}'.")
    kind = configurable[name]
    given = kind.__dataclass_fields__["config"]
    for key in read_toml(file):
        if key in kind.__dataclass_fields__ and key != "config":
            raise ConfigError(
                f"{file.name}: '{key}' says how '{name}' is run, which is no part of its configuration: give it on the "
                "command line."
            )
    values = load(given.default_factory, file)
    made = make_dataclass(
        kind.__name__, [("config", given.type, field(default=values))], bases=(kind,), frozen=True, kw_only=True
    )
    made.__doc__ = kind.__doc__
    return made


_DESCRIPTION = """Contact-rich robot tasks, from the operator's hand to a policy that does them, with force.

`wrenchflow quickstart OUT` runs everything once. `--config FILE.toml`, after a command, sets its configuration.
"""
