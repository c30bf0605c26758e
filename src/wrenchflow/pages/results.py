"""Sections on what came out: success with its interval beside the baselines, and force against its limit."""

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from typing import Any

from wrenchflow.pages.page import NBSP, amount, bar, between, card, cards, chance, link, percent, section, table
from wrenchflow.pages.plot_block import plot_block
from wrenchflow.pages.result_plots import peak_force_figure

FORCE_LIMIT_N = 25.0  # Where a summary does not say its own.

OVER_FORCE = (
    "Over-force means that an attempt pressed harder than the limit at any moment after the tare, even if it got "
    "the task done: it then counts as a failure."
)


@dataclass(frozen=True, kw_only=True)
class Arm:
    """One way of doing the task, as keys of a summary and as words."""

    prefix: str
    name: str
    note: str


ARMS = (
    Arm(prefix="", name="policy", note="sees the wrench, as it was trained"),
    Arm(prefix="zeroed_force_", name="policy, force zeroed", note="the same weights; the wrench reads zero at test"),
    Arm(
        prefix="without_force_",
        name="trained without force",
        note="the same training, without wrench and what leaks it",
    ),
    Arm(prefix="blind_spiral_", name="blind spiral", note="no learning: presses and winds around the perceived goal"),
)


def attempts_of(summary: Mapping[str, Any]) -> int:
    """How many attempts a summary is of: `rollouts` in one of quickstart, `attempts` in one of deploy."""
    return summary["rollouts"] if "rollouts" in summary else summary["attempts"]


def limit_of(summary: Mapping[str, Any]) -> float:
    """The force that counts as over-force [N]."""
    return summary.get("force_limit_n", FORCE_LIMIT_N)


def success_card(summary: Mapping[str, Any]) -> str:
    """Success rate with its interval, in large type."""
    counted = f"{summary['successes']} of {attempts_of(summary)} attempts; "
    return card(
        "success",
        percent(summary["success_rate"]),
        f"{counted}95 % Wilson interval {between(summary['success_interval'])}",
    )


def force_card(summary: Mapping[str, Any]) -> str:
    """Peak force, in large type."""
    peak = summary["peak_force_n"]
    detail = f"95 % of attempts stay under {amount(peak['p95'], 1, 'N')}; largest {amount(peak['max'], 1, 'N')}"
    return card("peak force, median", amount(peak["median"], 1, "N"), f"{detail}; limit {limit_of(summary):g} N")


def success_section(summary: Mapping[str, Any]) -> str:
    """Success of every arm that the summary knows, with intervals."""
    arms = [arm for arm in ARMS if f"{arm.prefix}success_rate" in summary]
    # A page of one policy cannot know what that policy sees.
    rows = [_arm_row(arm, arm.note if len(arms) > 1 else "", summary) for arm in arms]
    against = ""
    if len(arms) > 1:
        against = (
            " All rows met the same starts and the same errors of perception, so they can be compared one by one "
            "(McNemar's exact test)."
        )
    text = (
        f"<p>An attempt counts when the task is done in time and the low-passed force stays under "
        f"{limit_of(summary):g} N. The whiskers are 95 % Wilson intervals.{against}</p>"
    )
    head = ("who acts", "success", "95 % interval", "0 to 100 %")
    return section("Success", text, table(head, rows, wide=True, main=0), _failures(summary))


def _arm_row(arm: Arm, note: str, summary: Mapping[str, Any]) -> tuple[str, ...]:
    rate, interval = summary[f"{arm.prefix}success_rate"], summary[f"{arm.prefix}success_interval"]
    words = f"{arm.name}: {percent(rate)}, 95 % interval {between(interval)}"
    p_value = summary.get(f"{arm.prefix}p_value")
    if p_value is not None:
        note += f"; {chance(p_value).replace(' ', NBSP)} against the policy"
    return (
        f"{escape(arm.name)}<small>{escape(note)}</small>",
        f'<td class="figure">{percent(rate)}</td>',
        f'<td class="figure">{between(interval)}</td>',
        bar(rate, words, interval=(interval[0], interval[1]), main=not arm.prefix),
    )


def _failures(summary: Mapping[str, Any]) -> str:
    named = ", ".join(f"{count} {escape(name)}" for name, count in summary["failures"].items())
    return f"<p>Failures of the policy: {named or 'none'}. {OVER_FORCE}</p>"


def force_section(summary: Mapping[str, Any]) -> str:
    """Force and time, of the policy and of the demonstrations where they are known, and peaks against the limit."""
    columns = [("policy", summary)]
    if "demonstrations" in summary:
        columns.append(("demonstrations", summary["demonstrations"]))
    rows = [
        (
            label,
            *(amount(part[key][at], digits, unit) if at in part.get(key, {}) else "not given" for _, part in columns),
        )
        for label, key, at, digits, unit in (
            ("peak force, median", "peak_force_n", "median", 1, "N"),
            ("peak force, 95th percentile", "peak_force_n", "p95", 1, "N"),
            ("peak force, largest", "peak_force_n", "max", 1, "N"),
            ("time of a success, median", "duration_s", "median", 2, "s"),
            ("time of a success, 95th percentile", "duration_s", "p95", 2, "s"),
        )
        if any(at in part.get(key, {}) for _, part in columns)
    ]
    rows.insert(0, ("success", *(percent(part["success_rate"]) for _, part in columns)))
    text = (
        "<p>Peak force is the largest norm of the low-passed force in one attempt, without the sensor's bias and the "
        "tool's weight.</p>"
    )
    peaks_n = summary.get("peak_forces_n")
    plot = plot_block(peak_force_figure(peaks_n, limit_of(summary)), "peak-force") if peaks_n else ""
    return section("Force and time", text, table(("", *(name for name, _ in columns)), rows), plot)


def stage_section(seconds: Mapping[str, float]) -> str:
    """Where the time went."""
    longest = max(seconds.values(), default=0.0) or 1.0
    rows = [
        (
            escape(stage),
            f'<td class="figure">{amount(spent, 1, "s")}</td>',
            bar(spent / longest, f"{stage} {spent:.1f} s"),
        )
        for stage, spent in seconds.items()
    ]
    rows.append(("<b>together</b>", f'<td class="figure"><b>{amount(sum(seconds.values()), 1, "s")}</b></td>', ""))
    return section("Seconds per stage", table(("stage", "time", ""), rows, wide=True))


def result_cards(summary: Mapping[str, Any], *more: str) -> str:
    """The two figures that matter most, then `more` cards."""
    return cards(success_card(summary), force_card(summary), *more)


def links_section(links: tuple[tuple[str, str], ...], *more: str) -> str:
    """Links to files, as (text, relative path), then `more` HTML."""
    items = "".join(f"<li>{link(text, path)} <small><code>{escape(path)}</code></small></li>" for text, path in links)
    return section("Files", f"<ul>{items}</ul>" if items else "", *more)
