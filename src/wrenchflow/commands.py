"""The commands: what each takes, which stage it runs, and what it has to say of it."""

import logging
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any

from tqdm import tqdm
from tyro.conf import Positional, arg

from wrenchflow.collect.config import PEOPLE, CollectConfig
from wrenchflow.command import (
    _UNPREFIXED,
    EXIT_DONE,
    EXIT_ERROR,
    EXIT_GATE,
    Cluster,
    Command,
    Jobs,
    Out,
    Overwrite,
    Parallel,
    Resume,
    Stage,
    needs,
    watch,
)
from wrenchflow.config import to_mapping
from wrenchflow.curation_commands import Merge, Review, Select, Split
from wrenchflow.dataset_commands import Analyze, Restore
from wrenchflow.datasets.config import ExportConfig
from wrenchflow.deploy.config import DeployConfig
from wrenchflow.errors import ControlError
from wrenchflow.manifest import partial_of
from wrenchflow.process.calibrate_config import CalibrateConfig
from wrenchflow.process.config import ProcessConfig
from wrenchflow.quickstart_config import QuickstartConfig
from wrenchflow.told import (
    calibration_lines,
    collect_lines,
    doctor_lines,
    import_lines,
    process_lines,
    quickstart_lines,
    recording_lines,
    result_lines,
    validation_lines,
)
from wrenchflow.train.config import TrainConfig

_FORMATS = "robomimic, lerobot, zarr (Diffusion Policy's replay buffer), parquet, csv; several with commas."


@dataclass(frozen=True, kw_only=True)
class Quickstart(Stage):
    """Everything once on peg insertion: demonstrate, process, export, train, deploy, compare; ends in index.html."""

    out: Out
    config: Annotated[QuickstartConfig, _UNPREFIXED] = field(default_factory=QuickstartConfig)
    jobs: Jobs = 2

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.quickstart import run_quickstart

        summary = run_quickstart(self.out, self.config, watch, jobs=self.jobs, overwrite=self.overwrite)
        return summary | {"page": str(self.out / "index.html")}

    def text(self, result: dict[str, Any]) -> list[str]:
        """A short table."""
        return quickstart_lines(result)


@dataclass(frozen=True, kw_only=True)
class Collect(Stage):
    """Record demonstrations of a task to OUT/<id>.mcap."""

    out: Out
    config: Annotated[CollectConfig, _UNPREFIXED] = field(default_factory=CollectConfig)
    jobs: Jobs = 2
    resume: Resume = False
    review: Annotated[bool, arg(help="Ask after each attempt whether to keep it, where there is a terminal.")] = False
    viewer: Annotated[bool, arg(help="Show the scene to a person with a device, where there is a display.")] = True
    sound: Annotated[bool, arg(help="Let a person with a device hear a force that rises.")] = True

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.collect.board.choose import choose_board
        from wrenchflow.collect.coverage import empty_coverage
        from wrenchflow.collect.folder import collect_folder
        from wrenchflow.collect.session import kernels_of
        from wrenchflow.compiled import is_cold

        if is_cold(*kernels_of(self.config)):
            logging.getLogger("wrenchflow").warning("compiling the 1 kHz loop: one to three minutes, this once.")
        done, coverage = [], empty_coverage(self.config.task, self.config.rig)
        with choose_board(self.config, has_sound=self.sound) as board:
            for shown in collect_folder(
                self.out,
                self.config,
                jobs=self.jobs,
                overwrite=self.overwrite,
                resume=self.resume,
                board=board,
                review=self.review,
                viewer=self.viewer and self.config.operator in PEOPLE,
            ):
                board.add(shown)
                done.append(shown)
                coverage = coverage.with_(shown)
        told: dict[str, Any] = {
            "episodes": len(done),
            "samples": sum(demonstration.samples for demonstration in done),
            "successes": sum(demonstration.outcome.success for demonstration in done),
            "failures": dict(Counter(one.outcome.failure for one in done if not one.outcome.success)),
            "tares_refused": sum(len(demonstration.refused) for demonstration in done),
            "coverage": coverage.to_mapping(),
        }
        if len(done) < self.config.episodes:
            told["to_go"] = self.config.episodes - len(done)
        if self.config.is_paced:
            told["late_ticks"] = sum(demonstration.late_ticks for demonstration in done)
            told["lost"] = sum(demonstration.lost for demonstration in done)
            told["problems"] = [problem for demonstration in done for problem in demonstration.problems] or None
        return told | {"out": str(self.out)}

    def text(self, result: dict[str, Any]) -> list[str]:
        """Figures, and what has been covered."""
        return collect_lines(result)

    def can_go_on(self, error: BaseException) -> bool:
        """After an interrupt, or a stop of the arm, if a folder was begun."""
        from wrenchflow.collect.resume import BEGUN

        # What ends an attempt in virtual time by itself would end it again.
        is_stop = isinstance(error, KeyboardInterrupt) or (isinstance(error, ControlError) and self.config.is_paced)
        return is_stop and (partial_of(self.out.resolve()) / BEGUN).exists()


@dataclass(frozen=True, kw_only=True)
class Calibrate(Stage):
    """Find out what hangs below the sensor, into OUT.toml: from recordings at rest, or by a motion in simulation."""

    out: Annotated[Positional[Path], arg(metavar="OUT.toml", help="The calibration to write.")]
    recordings: Annotated[
        Positional[tuple[Path, ...]],
        arg(metavar="RECORDING", help="Recordings (.mcap, .csv) of an arm that rests in several orientations."),
    ] = ()
    config: Annotated[CalibrateConfig, _UNPREFIXED] = field(default_factory=CalibrateConfig)

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.collect.calibrate import calibrate, simulated_truth

        today = datetime.now(UTC).date().isoformat()
        found = calibrate(self.out, self.recordings, self.config, date=today, overwrite=self.overwrite)
        truth = None if self.recordings else to_mapping(simulated_truth(self.config))
        return to_mapping(found) | {"truth": truth, "out": str(self.out)}

    def text(self, result: dict[str, Any]) -> list[str]:
        """What was found, how well, and what is true where that is known."""
        return calibration_lines(result)


@dataclass(frozen=True, kw_only=True)
class Import(Command):
    """Make raw recordings of what others recorded: CSV, MATLAB, MCAP, ROS 2 bags; MAPPING says what they hold."""

    mapping: Annotated[Positional[Path], arg(metavar="MAPPING.toml", help="What the numbers mean.")]
    out: Out
    files: Annotated[Positional[tuple[Path, ...]], arg(metavar="FILE...", help="Files, or folders of ROS 2 bags.")]
    overwrite: Overwrite = False
    jobs: Jobs = 2
    cluster: Cluster = None

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.cluster import executor_at
        from wrenchflow.imports.import_folder import import_folder

        with executor_at(self.cluster) as executor:
            importing = import_folder(
                self.mapping, self.out, self.files, jobs=self.jobs, overwrite=self.overwrite, executor=executor
            )
            episodes = [episode for file in watch("import", importing, len(self.files)) for episode in file]
        return {
            "episodes": len(episodes),
            "samples": sum(sum(episode.samples.values()) for episode in episodes),
            "notes": {episode.id: list(episode.notes) for episode in episodes if episode.notes},
            "out": str(self.out),
        }

    def text(self, result: dict[str, Any]) -> list[str]:
        """Figures, and what had to be assumed."""
        return import_lines(result)


@dataclass(frozen=True, kw_only=True)
class Process(Parallel):
    """Clean the force of the recordings in RAW, and say how far to believe it: writes OUT with a report."""

    raw: Annotated[Positional[Path], arg(metavar="RAW", help="Folder of recordings.")]
    out: Out
    config: Annotated[ProcessConfig, _UNPREFIXED] = field(default_factory=ProcessConfig)
    gate: Annotated[bool, arg(help="End with exit code 3 if any episode has a defect.")] = False

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.cluster import executor_at
        from wrenchflow.process.pipeline import REPORT, process_folder
        from wrenchflow.process.summary import summarise_quality

        with executor_at(self.cluster) as executor:
            processing = process_folder(
                self.raw, self.out, self.config, jobs=self.jobs, overwrite=self.overwrite, executor=executor
            )
            assessments = watch("process", processing, _count(self.raw))
        return summarise_quality(assessments) | {"report": str(self.out / REPORT)}

    def text(self, result: dict[str, Any]) -> list[str]:
        """Figures, and what is wrong."""
        return process_lines(result)

    def code(self, result: dict[str, Any]) -> int:
        """3 behind `--gate` for a folder with a defect."""
        return EXIT_GATE if self.gate and result["defects"] else EXIT_DONE


@dataclass(frozen=True, kw_only=True)
class Export(Parallel):
    """Make a data set of the recordings in CLEAN; OUT may hold one of each format."""

    format: Annotated[
        Positional[str], arg(metavar="FORMAT", help="robomimic, lerobot, zarr, parquet, csv; several with commas.")
    ]
    clean: Annotated[Positional[Path], arg(metavar="CLEAN", help="Processed recordings: a folder, or a selection.")]
    out: Out
    config: Annotated[ExportConfig, _UNPREFIXED] = field(default_factory=ExportConfig)

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.cluster import executor_at
        from wrenchflow.datasets.export import export_folder

        with executor_at(self.cluster) as executor:
            exporting = export_folder(
                self.format,
                self.clean,
                self.out,
                self.config,
                jobs=self.jobs,
                overwrite=self.overwrite,
                executor=executor,
            )
            episodes = watch(f"export {self.format}", exporting, _count(self.clean))
        return {
            "episodes": sum(not episode.left_out for episode in episodes),
            "left_out": {episode.id: episode.left_out for episode in episodes if episode.left_out},
            "divided_by_gaps": {episode.id: episode.parts for episode in episodes if episode.parts > 1},
            "steps": sum(episode.steps for episode in episodes),
            "marked_steps": sum(episode.invalid for episode in episodes),
            "out": str(self.out),
        }


@dataclass(frozen=True, kw_only=True)
class Train(Stage):
    """Train a policy on a data set, into the run folder OUT."""

    dataset: Annotated[Positional[Path], arg(metavar="DATASET", help="A .hdf5 file, or a LeRobot folder.")]
    out: Out
    start: Annotated[Path | None, arg(metavar="RUN", help="Go on from the policy of another run.")] = None
    config: Annotated[TrainConfig, _UNPREFIXED] = field(default_factory=TrainConfig)

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.train.run import train_folder

        training = train_folder(self.dataset, self.out, self.config, start=self.start, overwrite=self.overwrite)
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
class Deploy(Stage):
    """Let the policy of RUN try a task many times, in virtual time; writes OUT/<id>.mcap and evaluation.json."""

    policy: Annotated[Positional[Path], arg(name="run", metavar="RUN", help="Folder that `train` wrote.")]
    out: Out
    config: Annotated[DeployConfig, _UNPREFIXED] = field(default_factory=DeployConfig)
    jobs: Jobs = 2

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
class Info(Command):
    """Show what a recording, a data set or a stage's folder holds."""

    path: Annotated[Positional[Path], arg(metavar="FILE", help="File or folder to look at.")]

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.describe import describe

        return describe(self.path)

    def text(self, result: dict[str, Any]) -> list[str]:
        """Tables for a recording."""
        return recording_lines(result) if result["kind"] == "recording" else result_lines(result)


@dataclass(frozen=True, kw_only=True)
class Validate(Command):
    """Look at all of a recording or a data set and say all that is wrong; exit code 1 if anything is."""

    path: Annotated[Positional[Path], arg(metavar="FILE", help="A recording (.mcap), or a data set.")]

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.datasets.validation.check import check, is_dataset
        from wrenchflow.recording.validate import validate

        if is_dataset(self.path):
            checked = check(self.path)
            problems = [line for each in checked for line in each.lines()]
            return {
                "valid": not problems,
                "checked": [each.file for each in checked],
                "problems": problems,
                "streams": {},
            }
        found = validate(self.path)
        return {
            "valid": not found.problems,
            "problems": list(found.problems),
            "streams": {name: to_mapping(report) for name, report in found.streams.items()},
        }

    def text(self, result: dict[str, Any]) -> list[str]:
        """Problems, then a line a stream."""
        return validation_lines(result)

    def code(self, result: dict[str, Any]) -> int:
        """1 for a file that is not valid."""
        return EXIT_DONE if result["valid"] else EXIT_ERROR


@dataclass(frozen=True, kw_only=True)
class Recover(Command):
    """Save what can be saved of a recording that was cut off or damaged, ours or another's; it stays as it is."""

    path: Annotated[Positional[Path], arg(metavar="FILE", help="A recording, or what is left of one (.partial).")]
    out: Annotated[Path | None, arg(metavar="OUT", help="The new file; without it, <name>.recovered.mcap.")] = None

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.recording.recover import recover

        name = self.path.name.removesuffix(".partial").removesuffix(".mcap").removesuffix(".rows")
        out = self.out or self.path.with_name(f"{name}.recovered.mcap")
        return {**to_mapping(recover(self.path, out)), "out": str(out)}


@dataclass(frozen=True, kw_only=True)
class Replay(Command):
    """Drive the simulated arm with a recording's torques, and say how far it comes to lie from what was recorded."""

    path: Annotated[Positional[Path], arg(metavar="FILE", help="A recording made in simulation (.mcap).")]

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.recording.reader import read_episode
        from wrenchflow.sim.replay import replay

        return to_mapping(replay(read_episode(self.path)))


@dataclass(frozen=True, kw_only=True)
class View(Command):
    """Open a recording in Rerun: pose, wrench, cameras, and contact where it was processed; or save what it shows."""

    path: Annotated[Positional[Path], arg(metavar="FILE", help="A recording (.mcap).")]
    save: Annotated[Path | None, arg(metavar="OUT.rrd", help="Write Rerun's file instead of opening a window.")] = None
    overwrite: Overwrite = False

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.recording.reader import read_episode

        with needs("rerun", "view"):
            from wrenchflow.view.show import save, show

        episode = read_episode(self.path)
        if self.save is None:
            show(episode)
            return {"shown": str(self.path)}
        save(episode, self.save, overwrite=self.overwrite)
        return {"out": str(self.save)}


@dataclass(frozen=True, kw_only=True)
class Doctor(Command):
    """Look at what this machine can and cannot do; exit code 1 if something essential is missing."""

    folder: Annotated[Path, arg(metavar="FOLDER", help="Where recordings would go.")] = Path(".")

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.doctor.examine import checks

        looks = checks(self.folder)
        found = watch("doctor", (look() for look in looks.values()), len(looks))
        return {"ready": not any(check.stops for check in found), "checks": [to_mapping(check) for check in found]}

    def text(self, result: dict[str, Any]) -> list[str]:
        """A line a check, with what it means and what to do beneath."""
        return doctor_lines(result)

    def code(self, result: dict[str, Any]) -> int:
        """1 where nothing can be recorded."""
        return EXIT_DONE if result["ready"] else EXIT_ERROR


COMMANDS: Mapping[str, type[Command]] = MappingProxyType(
    {
        "quickstart": Quickstart,
        "collect": Collect,
        "calibrate": Calibrate,
        "import": Import,
        "process": Process,
        "review": Review,
        "select": Select,
        "merge": Merge,
        "split": Split,
        "export": Export,
        "analyze": Analyze,
        "restore": Restore,
        "train": Train,
        "deploy": Deploy,
        "info": Info,
        "validate": Validate,
        "recover": Recover,
        "replay": Replay,
        "view": View,
        "doctor": Doctor,
    }
)


def _count(folder: Path) -> int:
    if folder.suffix == ".json" and folder.is_file():
        from wrenchflow.datasets.curation.selection import read_selection

        return len(read_selection(folder).entries)
    return sum(1 for _ in folder.glob("*.mcap")) if folder.is_dir() else 0
