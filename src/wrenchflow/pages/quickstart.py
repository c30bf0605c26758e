"""The page that `quickstart` leaves: what was done, what came out, what it looks like, and where the files are."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from wrenchflow.episode import Episode
from wrenchflow.pages.attempts import WHAT_IS_DRAWN, attempts_section, points_for
from wrenchflow.pages.page import amount, card, footer_line, page, percent, section
from wrenchflow.pages.plot_block import plot_block
from wrenchflow.pages.result_plots import training_figure
from wrenchflow.pages.results import force_section, links_section, result_cards, stage_section, success_section

_HOW_TO_OPEN = (
    ("Recordings (.mcap): Foxglove or PlotJuggler open them as they are; on a command line", "wrenchflow info {mcap}"),
    (
        "robomimic's own view of the HDF5 file",
        "python -m robomimic.scripts.get_dataset_info --dataset dataset/robomimic.hdf5",
    ),
    (
        "LeRobot, in Python",
        "from lerobot.datasets.lerobot_dataset import LeRobotDataset\n"
        'dataset = LeRobotDataset("local/{task}", root="dataset/lerobot")',
    ),
    (
        "LeRobot's viewer",
        "lerobot-dataset-viz --repo-id local/{task} --root dataset/lerobot --episode-index 0",
    ),
)


def quickstart_page(
    summary: Mapping[str, Any],
    demonstrations: Sequence[tuple[Episode, str]],
    rollouts: Sequence[tuple[Episode, str]],
    links: Sequence[tuple[str, str]],
) -> str:
    """The whole page, with its plots and without a need for a network.

    Args:
        summary: The figures that `quickstart --json` prints, with `training`, `peak_forces_n` and `force_limit_n` where
            they are known.
        demonstrations: Clean episodes to show, each with the relative path of its file; the first is open.
        rollouts: The same of the policy; the first one and the first failed one are open.
        links: Text and relative path of each file or folder to link to.
    """
    task = summary["task"]
    points = points_for(demonstrations, rollouts)
    return page(
        f"wrenchflow quickstart: {task}",
        [
            _headline(summary),
            result_cards(summary, _demonstrations_card(summary), _time_card(summary["seconds"])),
            success_section(summary),
            force_section(summary),
            attempts_section(
                "Demonstrations",
                demonstrations,
                name="demonstration",
                points=points,
                text=f"What the policy learned from. {WHAT_IS_DRAWN}",
            ),
            attempts_section(
                "Rollouts",
                rollouts,
                name="rollout",
                points=points,
                text="The policy at work on starts that it was never shown. The goal is where the task is perceived "
                "to be, which is a little off: a success need not end at zero in x and y.",
            ),
            _training_section(summary),
            stage_section(summary["seconds"]),
            links_section(tuple(links), _opening(task, demonstrations)),
        ],
        footer_line(summary),
    )


def _headline(summary: Mapping[str, Any]) -> str:
    return (
        f"<h1>{escape(summary['task'])}: from demonstrations to a policy that feels</h1>"
        f"<p>{summary['episodes']} demonstrations were recorded on a simulated arm under impedance control, their "
        "force was cleaned, they were exported for robomimic and LeRobot, and a policy was trained on them. It then "
        f"tried the task {summary['rollouts']} times from new starts: the policy chooses where to go, and the 1 kHz "
        "control core follows.</p>"
    )


def _demonstrations_card(summary: Mapping[str, Any]) -> str:
    detail = f"{summary['samples']:,} samples; {percent(summary['demonstrations']['success_rate'])} of them succeed"
    return card("demonstrations", f"{summary['episodes']}", detail)


def _time_card(seconds: Mapping[str, float]) -> str:
    slowest = max(seconds, key=lambda stage: seconds[stage], default=None)
    detail = f"most of it in {slowest}, {amount(seconds[slowest], 1, 's')}" if slowest else ""
    return card("time for everything", amount(sum(seconds.values()), 0, "s"), detail)


def _training_section(summary: Mapping[str, Any]) -> str:
    training = summary.get("training")
    if not training or not training.get("steps"):
        return ""
    text = "<p>A low loss does not rank policies: only rollouts do.</p>"
    return section("Training", text, plot_block(training_figure(training), "training"))


def _opening(task: str, demonstrations: Sequence[tuple[Episode, str]]) -> str:
    mcap = demonstrations[0][1] if demonstrations else "FILE.mcap"
    return "\n".join(
        f"<p>{escape(what)}:</p><pre>{escape(command.format(task=task, mcap=mcap))}</pre>"
        for what, command in _HOW_TO_OPEN
    )
