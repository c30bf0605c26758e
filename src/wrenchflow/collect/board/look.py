"""What a board looks like: a pure function of what is known, drawn by `rich`."""

from dataclasses import dataclass

import numpy as np
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from wrenchflow.collect.board.tally import Tally
from wrenchflow.collect.coverage_told import coverage_told

_BAR = 40
_BEYOND = 1.25  # A bar reaches a quarter further than the limit.
_AXES = ("fx", "fy", "fz", "|f|")


@dataclass(frozen=True, kw_only=True)
class Facts:
    """What does not change in a session.

    Attributes:
        title: Operator and task.
        limit_n: Force that spoils the work, or that the arm draws back from [N].
        modes: Names of the safety layer's modes.
        phases: Names of the task's phases.
        help: Lines that say what keys and device do.
    """

    title: str
    limit_n: float
    modes: tuple[str, ...]
    phases: tuple[str, ...]
    help: tuple[str, ...]


def look(
    facts: Facts, tally: Tally, id: str = "", row: np.void | None = None, rate_hz: float = 0.0, question: str = ""
) -> RenderableType:
    """All of it, in a frame.

    Args:
        facts: Of the session.
        tally: How far it is.
        id: Of the episode that is recorded.
        row: What its control loop said last, one `ROW`.
        rate_hz: At what rate it ticks.
        question: What is waited for.
    """
    parts: list[RenderableType] = [Text(f"episode {min(tally.kept + 1, tally.total)} of {tally.total}   {id}")]
    if row is not None:
        parts += [_state(facts, row, rate_hz), _bars(row["wrench"], facts.limit_n)]
        if problem := bytes(row["problem"]).decode(errors="replace"):
            parts.append(Text(f"device: {problem}: the arm holds", "bold red"))
    parts.append(_progress(tally))
    if question:
        parts.append(Text(question, "bold yellow"))
    parts += [Text(line, "dim") for line in facts.help]
    return Panel(Group(*parts), title=facts.title, title_align="left", expand=False)


def _state(facts: Facts, row: np.void, rate_hz: float) -> Text:
    if not row["is_under_way"]:
        phase = "tare: hands off"
    else:
        phase = facts.phases[row["phase"]] if row["phase"] >= 0 else "under way"
    gripper, mark = row["buttons"] & 1, row["buttons"] & 2
    text = Text(f"{rate_hz:4.0f} Hz   {row['elapsed_s']:5.1f} s   {phase:<16} {facts.modes[row['mode']]:<10}")
    text.append(f" late {row['late']}", "yellow" if row["late"] else "")
    text.append(f"  dropped {row['lost']}", "red" if row["lost"] else "")
    text.append("  gripper" if gripper else "", "cyan")
    text.append("  mark" if mark else "", "magenta")
    return text


def _bars(wrench: np.ndarray, limit_n: float) -> Table:
    table = Table.grid(padding=(0, 1))
    for name, force_n in zip(_AXES, [*wrench[:3], np.linalg.norm(wrench[:3])], strict=True):
        table.add_row(name, Text(f"{force_n:6.1f} N", justify="right"), _bar(float(abs(force_n)) / limit_n))
    table.add_row("", "", Text(" " * round(_BAR / _BEYOND) + f"^ {limit_n:.0f} N"))
    return table


def _bar(share: float) -> Text:
    filled = round(min(share / _BEYOND, 1.0) * _BAR) if np.isfinite(share) else _BAR
    limit = round(_BAR / _BEYOND)
    cells = ["█" if at < filled else "·" for at in range(_BAR)]
    cells[limit] = "▌" if filled > limit else "|"
    return Text("".join(cells), "red" if share > 0.8 else "yellow" if share > 0.5 else "green")


def _progress(tally: Tally) -> Text:
    share = tally.kept / tally.total
    text = Text("█" * round(share * _BAR) + "·" * (_BAR - round(share * _BAR)), "blue")
    text.append(f" {tally.kept} kept", "bold")
    text.append(f" ({tally.failed} of them failed), {tally.discarded} discarded", "")
    covered = coverage_told(tally.coverage.to_mapping())
    text.append(f"\nstarts {covered['starts']}, goals {covered['goals']}; {covered['successes_by']}", "")
    return text
