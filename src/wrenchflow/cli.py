"""The command line: parse, dispatch, print, exit codes. The only place that prints."""

import json
import math
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, make_dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro
from tqdm import tqdm
from tyro.conf import Positional, arg

from wrenchflow import __version__
from wrenchflow.collect.config import CollectConfig
from wrenchflow.config import load, to_mapping
from wrenchflow.datasets.config import ExportConfig
from wrenchflow.deploy.config import DeployConfig
from wrenchflow.errors import ConfigError, WrenchflowError
from wrenchflow.process.config import ProcessConfig
from wrenchflow.quickstart_config import QuickstartConfig
from wrenchflow.train.config import TrainConfig

EXIT_DONE, EXIT_ERROR, EXIT_USAGE, EXIT_INTERRUPTED = 0, 1, 2, 130

Overwrite = Annotated[bool, arg(help="Replace outputs that are there.")]
Jobs = Annotated[int, arg(help="Worker processes.")]
Json = Annotated[bool, arg(help="Print one JSON object instead of text.")]
# A config's own fields are flags without a prefix, `--steps`; what is nested in it keeps one, `--policy.mlp.width`.
_UNPREFIXED = arg(name="")


def watch[T](stage: str, results: Iterator[T], total: int) -> list[T]:
    """Exhaust a stage's results behind a progress bar, where there is a terminal to draw it on."""
    return list(tqdm(results, desc=stage, total=total, disable=None, dynamic_ncols=True, leave=False))


@dataclass(frozen=True, kw_only=True)
class _Command(ABC):
    """What all commands share."""

    json: Json = False

    @abstractmethod
    def run(self) -> dict[str, Any]:
        """Do the work; returns plain figures."""

    def text(self, result: dict[str, Any]) -> list[str]:
        """The result as lines for a person."""
        return _lines(result)


@dataclass(frozen=True, kw_only=True)
class Quickstart(_Command):
    """Everything once on peg insertion: demonstrate, process, export, train, deploy, compare; ends in index.html."""

    out: Positional[Path]
    config: Annotated[QuickstartConfig, _UNPREFIXED] = field(default_factory=QuickstartConfig)
    jobs: Jobs = 2
    overwrite: Overwrite = False

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.quickstart import run_quickstart

        summary = run_quickstart(self.out, self.config, watch, jobs=self.jobs, overwrite=self.overwrite)
        return summary | {"page": str(self.out / "index.html")}

    def text(self, result: dict[str, Any]) -> list[str]:
        """A short table."""
        return _quickstart_lines(result)


@dataclass(frozen=True, kw_only=True)
class Collect(_Command):
    """Record demonstrations of a task to OUT/<id>.mcap."""

    out: Positional[Path]
    config: Annotated[CollectConfig, _UNPREFIXED] = field(default_factory=CollectConfig)
    jobs: Jobs = 2
    overwrite: Overwrite = False

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.collect.session import collect_folder

        collecting = collect_folder(self.out, self.config, jobs=self.jobs, overwrite=self.overwrite)
        done = watch("collect", collecting, self.config.episodes)
        return {
            "episodes": len(done),
            "samples": sum(demonstration.samples for demonstration in done),
            "successes": sum(demonstration.outcome.success for demonstration in done),
            "out": str(self.out),
        }


@dataclass(frozen=True, kw_only=True)
class Process(_Command):
    """Clean the force of the recordings in RAW: bias, gravity, filter, contacts; writes OUT and its quality report."""

    raw: Positional[Path]
    out: Positional[Path]
    config: Annotated[ProcessConfig, _UNPREFIXED] = field(default_factory=ProcessConfig)
    jobs: Jobs = 2
    overwrite: Overwrite = False

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.process.pipeline import process_folder

        processing = process_folder(self.raw, self.out, self.config, jobs=self.jobs, overwrite=self.overwrite)
        qualities = watch("process", processing, _count(self.raw))
        return {
            "episodes": len(qualities),
            "with_contact": sum(quality.has_contact for quality in qualities),
            "max_force_n": max(quality.max_force for quality in qualities),
            "report": str(self.out / "report.html"),
        }


@dataclass(frozen=True, kw_only=True)
class Export(_Command):
    """Make a data set of the recordings in CLEAN: FORMAT is robomimic or lerobot; OUT may hold both."""

    format: Positional[str]
    clean: Positional[Path]
    out: Positional[Path]
    config: Annotated[ExportConfig, _UNPREFIXED] = field(default_factory=ExportConfig)
    jobs: Jobs = 2
    overwrite: Overwrite = False

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.datasets.export import export_folder

        exporting = export_folder(
            self.format, self.clean, self.out, self.config, jobs=self.jobs, overwrite=self.overwrite
        )
        episodes = watch(f"export {self.format}", exporting, _count(self.clean))
        return {
            "episodes": sum(not episode.left_out for episode in episodes),
            "left_out": {episode.id: episode.left_out for episode in episodes if episode.left_out},
            "steps": sum(episode.steps for episode in episodes),
            "out": str(self.out),
        }


@dataclass(frozen=True, kw_only=True)
class Train(_Command):
    """Train a policy on a data set (robomimic .hdf5 or LeRobot folder) into the run folder OUT."""

    dataset: Positional[Path]
    out: Positional[Path]
    config: Annotated[TrainConfig, _UNPREFIXED] = field(default_factory=TrainConfig)
    overwrite: Overwrite = False

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.train.run import train_folder

        training = train_folder(self.dataset, self.out, self.config, overwrite=self.overwrite)
        last = None
        with tqdm(total=self.config.steps, desc="train", disable=None, dynamic_ncols=True, leave=False) as bar:
            for progress in training:
                last = progress.metrics
                bar.update(last.step - bar.n)
                bar.set_postfix(loss=f"{last.loss:.4f}")
        assert last is not None  # A training has at least one update, and the last one yields a row.
        return {
            "steps": last.step,
            "loss": last.loss,
            "valid_loss": last.valid_loss,
            "valid_position_error_m": last.valid_position_error_m,
            "out": str(self.out),
        }


@dataclass(frozen=True, kw_only=True)
class Deploy(_Command):
    """Let the policy of RUN try a task many times, in virtual time; writes OUT/<id>.mcap and evaluation.json."""

    policy: Annotated[Positional[Path], arg(name="run")]
    out: Positional[Path]
    config: Annotated[DeployConfig, _UNPREFIXED] = field(default_factory=DeployConfig)
    jobs: Jobs = 2
    overwrite: Overwrite = False

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.deploy.evaluation import summarise
        from wrenchflow.deploy.run import deploy_folder
        from wrenchflow.present import write_evaluation_page

        deploying = deploy_folder(self.policy, self.out, self.config, jobs=self.jobs, overwrite=self.overwrite)
        verdicts = watch("deploy", deploying, self.config.episodes)
        write_evaluation_page(self.out, self.config.task, verdicts, self.config.force_limit_n)
        return summarise(verdicts) | {"out": str(self.out), "page": str(self.out / "evaluation.html")}


@dataclass(frozen=True, kw_only=True)
class Info(_Command):
    """Show what a recording, a data set or a stage's folder holds."""

    path: Positional[Path]

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.describe import describe

        return describe(self.path)


COMMANDS: dict[str, type[_Command]] = {
    "quickstart": Quickstart,
    "collect": Collect,
    "process": Process,
    "export": Export,
    "train": Train,
    "deploy": Deploy,
    "info": Info,
}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code: 0 done, 1 a known error, 2 usage, 130 interrupted."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        if arguments in (["--version"], ["-V"]):
            print(__version__)
            return EXIT_DONE
        command = _parse(arguments)
        _require_sound(command)
        result = command.run()
    except WrenchflowError as error:
        print(f"wrenchflow: {error}", file=sys.stderr)
        return EXIT_ERROR
    except KeyboardInterrupt:
        print("wrenchflow: interrupted.", file=sys.stderr)
        return EXIT_INTERRUPTED
    except SystemExit as stop:  # tyro leaves so: after its help, or with its own word on a usage error.
        return EXIT_USAGE if stop.code else EXIT_DONE
    print(json.dumps(result) if command.json else "\n".join(command.text(result)))
    return EXIT_DONE


def _parse(arguments: list[str]) -> _Command:
    commands: dict[str, Callable[..., _Command]] = dict(COMMANDS)
    if "--config" in arguments:
        # `--config FILE` gives the defaults that other flags then change, so it is read before the rest is parsed.
        at = arguments.index("--config")
        if at + 1 == len(arguments):
            raise ConfigError("--config takes a TOML file, got nothing after it.")
        name, file = arguments[0], Path(arguments[at + 1])
        arguments = arguments[:at] + arguments[at + 2 :]
        commands[name] = _with_defaults(name, file)
    return tyro.extras.subcommand_cli_from_dict(
        commands, prog="wrenchflow", description=_DESCRIPTION, args=arguments, sort_subcommands=False
    )


def _require_sound(command: _Command) -> None:
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
        if name == "seed" and value < 0:
            raise ConfigError(f"seed is {value}, expected 0 or more.")


def _numbers(values: Any, name: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(values, Mapping):
        for key, value in values.items():
            yield from _numbers(value, f"{name}.{key}" if name else key)
    elif isinstance(values, int | float) and not isinstance(values, bool):
        yield name, values


def _with_defaults(name: str, file: Path) -> type[_Command]:
    """A command whose config has the values of a TOML file as its defaults."""
    configurable = {known: kind for known, kind in COMMANDS.items() if "config" in kind.__dataclass_fields__}
    if name not in configurable:
        raise ConfigError(f"--config follows one of the commands {', '.join(configurable)}, got '{name}'.")
    kind = configurable[name]
    given = kind.__dataclass_fields__["config"]
    values = load(given.default_factory, file)
    made = make_dataclass(
        kind.__name__, [("config", given.type, field(default=values))], bases=(kind,), frozen=True, kw_only=True
    )
    made.__doc__ = kind.__doc__
    return made


def _lines(result: Mapping[str, Any], indent: str = "") -> list[str]:
    """A result as aligned lines, tables within tables further in."""
    width = max((len(str(key)) for key in result), default=0)
    lines = []
    for key, value in result.items():
        if isinstance(value, Mapping) and value:
            lines += [f"{indent}{key}", *_lines(value, indent + "  ")]
        else:
            lines.append(f"{indent}{key!s:<{width}}  {_said(value)}")
    return lines


def _said(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        return " ".join(_said(item) for item in value)
    return "none" if value == {} else str(value)


def _quickstart_lines(summary: Mapping[str, Any]) -> list[str]:
    """The short table that `quickstart` ends with."""

    def rate(name: str) -> str:
        low, high = summary[f"{name}success_interval"]
        return f"{summary[f'{name}success_rate']:6.1%}   [{low:.1%}, {high:.1%}]"

    def force(name: str) -> str:
        peak = summary[f"{name}peak_force_n"]
        return f"{peak['median']:5.1f} / {peak['p95']:.1f} N"

    arms = {
        "policy, with force": "",
        "the same, force zeroed": "zeroed_force_",
        "trained without force": "without_force_",
        "blind spiral": "blind_spiral_",
    }
    shown = summary["demonstrations"]
    return [
        f"demonstrations  {summary['episodes']} episodes, {summary['samples']:,} samples at 1 kHz, "
        f"{shown['success_rate']:.1%} inserted",
        f"{summary['rollouts']} rollouts each       success  95 % interval     peak force, median / 95 %",
        *(f"  {label:<23} {rate(name)}   {force(name)}" for label, name in arms.items()),
        f"success: inserted within 8 s, low-passed peak force under {summary['force_limit_n']:.0f} N",
        "seconds         " + "  ".join(f"{stage} {value:.0f}" for stage, value in summary["seconds"].items()),
        f"open            {summary['page']}",
    ]


def _count(folder: Path) -> int:
    return sum(1 for _ in folder.glob("*.mcap")) if folder.is_dir() else 0


_DESCRIPTION = """Contact-rich robot tasks, from the operator's hand to a policy that does them, with force.

`wrenchflow quickstart OUT` runs everything once. `--config FILE.toml`, after a command, gives the values of its flags.
"""
