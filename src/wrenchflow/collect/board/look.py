"""What a board looks like: a pure function of what is known, drawn by `rich`."""

from dataclasses import dataclass

import numpy as np
from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from wrenchflow.collect.board.tally import Tally
from wrenchflow.collect.coverage_told import coverage_told
from wrenchflow.spatial import rotation_of

_WIDTH, _BAR, _PROGRESS = 80, 40, 24
_BEYOND = 1.25  # A bar reaches a quarter further than the limit.
_AXES = ("fx", "fy", "fz", "|f|")


@dataclass(frozen=True, kw_only=True)
class Facts:
    """What does not change in a session.

    Attributes:
        title: Operator and task.
        limit_n: Force that spoils the work, or that the arm draws back from [N].
        full_speed_m_s: Of the target, at full deflection of the device [m/s].
        modes: Names of the safety layer's modes.
        phases: Names of the task's phases.
        help: Lines that say what keys and device do.
    """

    title: str
    limit_n: float
    full_speed_m_s: float
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
        parts += [_state(facts, row, rate_hz), *_place(row), _hand(facts, row), _bars(row["wrench"], facts.limit_n)]
        if problem := bytes(row["problem"]).decode(errors="replace"):
            parts.append(Text(f"device: {problem}: the arm holds", "bold red"))
    parts.append(_progress(tally))
    if question:
        parts.append(Text(question, "bold yellow"))
    else:
        parts += [Text(line, "dim") for line in facts.help]
    # As wide whatever is in it: a frame that jumps cannot be read.
    return Panel(Group(*parts), title=facts.title, title_align="left", width=_WIDTH)


def _state(facts: Facts, row: np.void, rate_hz: float) -> Text:
    if not row["is_under_way"]:
        phase = "tare: hands off"
    else:
        phase = facts.phases[row["phase"]] if row["phase"] >= 0 else "under way"
    text = Text(f"{rate_hz:4.0f} Hz   {row['elapsed_s']:5.1f} s   {phase:<16} {facts.modes[row['mode']]:<10}")
    text.append(f" late {row['late']}", "yellow" if row["late"] else "")
    text.append(f"  dropped {row['lost']}", "red" if row["lost"] else "")
    return text


def _place(row: np.void) -> list[RenderableType]:
    """Where the tool is from the goal, as it is perceived; nothing before that is known."""
    tcp, goal = row["tcp_pose"], row["goal_pose"]
    if not (tcp.any() and goal.any()):
        return []
    x, y, z = (tcp[:3] - goal[:3]) * 1e3
    turned = rotation_of(tcp[3:]) @ rotation_of(goal[3:]).T
    # The turn about the vertical that comes nearest to all of it.
    yaw_deg = np.degrees(np.arctan2(turned[1, 0] - turned[0, 1], turned[0, 0] + turned[1, 1]))
    return [Text(f"from the goal   x {x:+7.1f}   y {y:+7.1f}   z {z:+7.1f} mm   yaw {yaw_deg:+6.1f}°", "bold")]


def _hand(facts: Facts, row: np.void) -> Text:
    """How fast the device moves the tool, and what is pressed."""
    speed_mm_s = float(row["speed_share"]) * facts.full_speed_m_s * 1e3
    name = bytes(row["speed_name"]).decode(errors="replace")
    text = Text(f"speed {name}: {speed_mm_s:.0f} mm/s" if name else f"speed: {speed_mm_s:.0f} mm/s at most")
    text.append("   gripper" if row["buttons"] & 1 else "", "cyan")
    text.append("   mark" if row["buttons"] & 2 else "", "magenta")
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
    text = Text("█" * round(share * _PROGRESS) + "·" * (_PROGRESS - round(share * _PROGRESS)), "blue")
    text.append(f" {tally.kept} kept", "bold")
    text.append(f" ({tally.failed} of them failed), {tally.discarded} discarded", "")
    covered = tally.coverage.to_mapping()
    told = coverage_told(covered)
    text.append(f"\nstarts {told['starts']}, goals {told['goals']}", "")
    people = [f"{who} {done}/{tried}" for who, (done, tried) in covered["successes_by"].items()]
    text.append(f"\n{', '.join(people)}" if people else "", "")
    return text
