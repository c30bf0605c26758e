"""Results as lines for a person to read."""

from collections import Counter
from collections.abc import Mapping
from textwrap import wrap
from typing import Any

from wrenchflow.pages.page import chance


def result_lines(result: Mapping[str, Any], indent: str = "") -> list[str]:
    """A result as aligned lines, tables within tables further in."""
    width = max((len(str(key)) for key in result), default=0)
    lines = []
    for key, value in result.items():
        if isinstance(value, Mapping) and value:
            lines += [f"{indent}{key}", *result_lines(value, indent + "  ")]
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


def validation_lines(found: Mapping[str, Any]) -> list[str]:
    """What `validate` says: the verdict, each problem, and how regular each stream is."""
    lines = ["valid" if found["valid"] else "not valid", *(f"  {problem}" for problem in found["problems"])]
    width = max((len(name) for name in found["streams"]), default=0)
    if width:
        lines.append(f"{'stream':<{width}}  samples    rate     gaps  longest gap    jitter  not finite")
    for name, report in found["streams"].items():
        rate = "-" if not report["period_s"] else f"{1.0 / report['period_s']:.0f} Hz"
        lines.append(
            f"{name:<{width}}  {report['samples']:7}  {rate:>7}  {report['gaps']:5}  "
            f"{report['longest_gap_s'] * 1e3:8.1f} ms  {report['jitter_s'] * 1e6:5.1f} us  {report['not_finite']:10}"
        )
    return lines


def doctor_lines(found: Mapping[str, Any]) -> list[str]:
    """What `doctor` says: a line a check, then what it means and what to do, and the verdict."""
    checks = found["checks"]
    width = max(len(check["name"]) for check in checks)
    lines = []
    for check in checks:
        said = [
            *_wrapped("", check["found"]),
            *_wrapped("  ", check["means"]),
            *_wrapped("> ", check["todo"]),
        ]
        lines.append(f"{check['state']:<7}  {check['name']:<{width}}  {said[0]}")
        lines += [" " * (width + 11) + line for line in said[1:]]
    counts = Counter(check["state"] for check in checks)
    told = f"{counts['ok']} ok, {counts['warning']} warnings, {counts['missing']} missing"
    stops = [check["name"] for check in checks if check["essential"] and check["state"] == "missing"]
    verdict = f"Not ready to record: {', '.join(stops)}." if stops else "Ready to record: nothing essential is missing."
    return [*lines, "", f"{verdict} {told}."]


def _wrapped(sign: str, text: str) -> list[str]:
    """Lines of at most 88 characters, with a sign before the first."""
    return wrap(text, 88, initial_indent=sign, subsequent_indent="  ", break_on_hyphens=False, break_long_words=False)


def quickstart_lines(summary: Mapping[str, Any]) -> list[str]:
    """The short table that `quickstart` ends with."""

    def rate(name: str) -> str:
        low, high = summary[f"{name}success_interval"]
        interval = f"[{low:.1%}, {high:.1%}]"
        return f"{summary[f'{name}success_rate']:6.1%}   {interval:<15}"

    def force(name: str) -> str:
        peak = summary[f"{name}peak_force_n"]
        p_value = summary.get(f"{name}p_value")
        return f"{peak['median']:5.1f} / {peak['p95']:.1f} N" + ("" if p_value is None else f"   {chance(p_value)}")

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
        f"{summary['rollouts']} rollouts each       success  95 % interval     peak force, median / 95 %, and paired p",
        *(f"  {label:<23} {rate(name)}   {force(name)}" for label, name in arms.items()),
        f"success: inserted within 8 s, low-passed peak force under {summary['force_limit_n']:.0f} N",
        "seconds         " + "  ".join(f"{stage} {value:.0f}" for stage, value in summary["seconds"].items()),
        f"open            {summary['page']}",
    ]
