"""Commands that say which recordings make a data set, without changing one of them."""

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional, arg

from wrenchflow.command import _UNPREFIXED, Command, Overwrite, Stage
from wrenchflow.config import to_mapping
from wrenchflow.datasets.curation.split_config import SplitConfig

_From = Annotated[Positional[Path], arg(metavar="FROM", help="Folder of processed recordings, or a selection.")]
_To = Annotated[Positional[Path], arg(metavar="OUT.json", help="The selection to write.")]


@dataclass(frozen=True, kw_only=True)
class Review(Command):
    """Say something about recordings of CLEAN, in review.json beside them; without --episode, show what is said."""

    clean: Annotated[Positional[Path], arg(metavar="CLEAN", help="Folder of processed recordings.")]
    episode: Annotated[str, arg(metavar="ID", help="The recording that something is said about.")] = ""
    trim: Annotated[tuple[float, float] | None, arg(metavar="START STOP", help="Keep only these seconds.")] = None
    label: Annotated[Literal["", "success", "failure", "unusable"], arg(help="What came of it.")] = ""
    task: Annotated[str, arg(help="The task that was attempted.")] = ""
    mark: Annotated[tuple[str, ...], arg(metavar="NAME:START:STOP", help="Name parts, in seconds.")] = ()
    note: Annotated[str, arg(help="Anything else.")] = ""
    by: Annotated[str, arg(help="Who says so.")] = ""
    clear: Annotated[bool, arg(help="Say nothing about it any more.")] = False

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.datasets.curation.edit import edit_review
        from wrenchflow.datasets.curation.review import read_review

        if self.episode:
            marks = tuple(self.mark)
            edit_review(
                self.clean,
                self.episode,
                trim_s=self.trim,
                label=self.label,
                task=self.task,
                marks=marks,
                note=self.note,
                by=self.by,
                clear=self.clear,
            )
        said = read_review(self.clean).episodes
        return {"reviewed": len(said), "episodes": {name: _short(to_mapping(each)) for name, each in said.items()}}


def _short(said: dict[str, Any]) -> dict[str, Any]:
    return {key: value for key, value in said.items() if value not in ("", None, [], ()) and key != "sha256"}


@dataclass(frozen=True, kw_only=True)
class Select(Command):
    """Choose recordings by a condition on their quality, into OUT.json; nothing is copied or deleted."""

    source: _From
    out: _To
    where: Annotated[str, arg(metavar="EXPR", help="Such as 'contact_fraction > 0.1 and peak_force_n < 40'.")] = ""
    only_success: Annotated[bool, arg(help="Leave out what did not succeed.")] = False
    overwrite: Overwrite = False

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.datasets.curation.choose import everything, select
        from wrenchflow.datasets.curation.selection import write_selection

        selection = select(everything(self.source), self.where, only_success=self.only_success)
        write_selection(self.out, selection, overwrite=self.overwrite)
        return _told(selection, self.out)


@dataclass(frozen=True, kw_only=True)
class Merge(Command):
    """Put folders and selections together, into OUT.json; a recording that is in two of them is taken once."""

    out: _To
    sources: Annotated[Positional[tuple[Path, ...]], arg(metavar="FROM...", help="Folders, or selections.")]
    overwrite: Overwrite = False

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.datasets.curation.choose import everything, merge
        from wrenchflow.datasets.curation.selection import write_selection

        selection = merge([everything(source) for source in self.sources])
        write_selection(self.out, selection, overwrite=self.overwrite)
        return _told(selection, self.out)


@dataclass(frozen=True, kw_only=True)
class Split(Stage):
    """Divide recordings into what trains, validates and tests, into OUT.json; a demonstration is never on two sides."""

    source: _From
    out: _To
    config: Annotated[SplitConfig, _UNPREFIXED] = field(default_factory=SplitConfig)

    def run(self) -> dict[str, Any]:
        """Do it."""
        from wrenchflow.datasets.curation.choose import everything, split
        from wrenchflow.datasets.curation.selection import write_selection

        selection = split(everything(self.source), self.config)
        write_selection(self.out, selection, overwrite=self.overwrite)
        return _told(selection, self.out)


def _told(selection: Any, out: Path) -> dict[str, Any]:
    """What a selection holds, and why the others are not in it."""
    reasons = Counter(entry.reason for entry in selection.left_out)
    splits = Counter(entry.split for entry in selection.entries if entry.split)
    return {
        "recordings": len(selection.entries),
        **({"splits": dict(sorted(splits.items()))} if splits else {}),
        "left_out": dict(reasons.most_common()),
        "out": str(out),
    }
