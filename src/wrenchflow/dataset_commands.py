"""Commands on data sets of any kind, ours and those of others."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Positional, arg

from wrenchflow.command import _UNPREFIXED, Command, Out, Overwrite, Parallel, watch
from wrenchflow.datasets.analysis.config import AnalysisConfig
from wrenchflow.told import analysis_lines


@dataclass(frozen=True, kw_only=True)
class Analyze(Parallel):
    """Look at any data set: recordings, robomimic HDF5, LeRobot v3, or a DROID tree; writes OUT with a page."""

    path: Annotated[Positional[Path], arg(metavar="PATH", help="The data set; it is only read.")]
    out: Out
    config: Annotated[AnalysisConfig, _UNPREFIXED] = field(default_factory=AnalysisConfig)

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.cluster import executor_at
        from wrenchflow.datasets.analysis.analyze import PAGE, analyze
        from wrenchflow.datasets.analysis.open_source import open_source
        from wrenchflow.datasets.analysis.tables import summary

        source = open_source(self.path)
        with executor_at(self.cluster) as executor:
            looking = analyze(
                source, self.path, self.out, self.config, jobs=self.jobs, overwrite=self.overwrite, executor=executor
            )
            analysis = watch("analyze", looking, len(source.places()))[-1]
        assert analysis is not None  # The last thing that it yields.
        return summary(analysis) | {"page": str(self.out / PAGE)}

    def text(self, result: dict[str, Any]) -> list[str]:
        """Figures, and what is wrong."""
        return analysis_lines(result)


@dataclass(frozen=True, kw_only=True)
class Restore(Command):
    """Make recordings again of a data set that wrenchflow exported: OUT/<recording>.mcap, the force at its own rate."""

    dataset: Annotated[Positional[Path], arg(metavar="DATASET", help="A robomimic .hdf5 file, or a LeRobot folder.")]
    out: Out
    overwrite: Overwrite = False

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.datasets.load import load_steps
        from wrenchflow.datasets.restore import joined, restore
        from wrenchflow.manifest import output_folder, write_manifest
        from wrenchflow.recording.write import write_episode

        recordings = joined(load_steps(self.dataset))
        with output_folder(self.out, overwrite=self.overwrite, reads=[self.dataset]) as partial:
            episodes = (write_episode(partial / f"{id}.mcap", restore(parts)) for id, parts in recordings.items())
            watch("restore", episodes, len(recordings))
            write_manifest(partial, "restore", {"dataset": self.dataset.name})
        return {"recordings": len(recordings), "out": str(self.out)}
