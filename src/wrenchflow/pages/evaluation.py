"""The page that `deploy` leaves beside `evaluation.json`: success, force, and what the attempts look like."""

from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from wrenchflow.episode import Episode
from wrenchflow.pages.attempts import WHAT_IS_DRAWN, attempts_section, points_for
from wrenchflow.pages.page import amount, footer_line, page
from wrenchflow.pages.results import attempts_of, force_section, links_section, result_cards, success_section


def evaluation_page(
    summary: Mapping[str, Any], rollouts: Sequence[tuple[Episode, str]], links: Sequence[tuple[str, str]]
) -> str:
    """The whole page, with its plots and without a need for a network.

    Args:
        summary: `task`, `attempts`, `successes`, `success_rate`, `success_interval`, `failures`, `peak_force_n` and
            `duration_s`; where they are known also the rates of baselines, `peak_forces_n`, `force_limit_n`, `seed` and
            `versions`.
        rollouts: Episodes to show, each with the relative path of its file; the first one and the first failed one
            are open.
        links: Text and relative path of each file or folder to link to.
    """
    done_s = summary["duration_s"]["median"]
    took = f"; a success took {amount(done_s, 2, 's')} (median)" if done_s is not None else ""
    return page(
        f"wrenchflow evaluation: {summary['task']}",
        [
            f"<h1>{escape(summary['task'])}: evaluation of a policy</h1>"
            f"<p>{attempts_of(summary)} attempts on starts that no demonstration has{took}.</p>",
            result_cards(summary),
            success_section(summary),
            force_section(summary),
            attempts_section("Rollouts", rollouts, name="rollout", points=points_for(rollouts), text=WHAT_IS_DRAWN),
            links_section(tuple(links)),
        ],
        footer_line(summary),
    )
