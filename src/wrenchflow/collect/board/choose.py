"""Which board a session has: on a terminal a drawn one, which another process draws where somebody demonstrates."""

import os
import sys

from wrenchflow.collect.board.board import Board, Lines
from wrenchflow.collect.board.tally import Tally
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.coverage import empty_coverage
from wrenchflow.collect.devices_table import DEVICES, help_of
from wrenchflow.collect.wishes import HELP
from wrenchflow.control.safeguards import MODES
from wrenchflow.sim.tasks import make_task


def choose_board(config: CollectConfig, *, has_sound: bool) -> Board:
    """The board for a configuration, on stderr.

    Args:
        config: What is demonstrated, by whom.
        has_sound: Whether a person hears a force that rises.

    Raises:
        ConfigError: If there is no such task or rig.
    """
    tally = Tally(total=config.episodes, coverage=empty_coverage(config.task, config.rig))
    if not sys.stderr.isatty() or os.environ.get("TERM", "dumb") == "dumb":
        return Lines(tally)
    from wrenchflow.collect.board.live_board import LiveBoard
    from wrenchflow.collect.board.look import Facts
    from wrenchflow.collect.board.screen import Screen

    task = make_task(config.task)
    facts = Facts(
        title=f"{config.operator}: {config.task}",
        limit_n=min(config.control.retreat_force_n, task.force_limit_n),
        full_speed_m_s=config.twist_map.linear_max_m_s,
        modes=MODES,
        phases=task.phases,
        help=(*help_of(config.operator), *HELP) if config.is_paced else ("Ctrl-C: stop; --resume goes on",),
    )
    if not config.is_paced:
        return Screen(facts, tally)
    return LiveBoard(facts, tally, has_sound=has_sound and config.operator in DEVICES)
