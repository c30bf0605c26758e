"""Results as lines for a person to read."""

from collections import Counter
from collections.abc import Mapping, Sequence
from textwrap import wrap
from typing import Any

from wrenchflow.collect.coverage_told import coverage_told
from wrenchflow.pages.page import chance

_NAMED = 3  # Episodes that a line names.


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


def collect_lines(result: Mapping[str, Any]) -> list[str]:
    """What `collect` recorded, and how much of what can happen that has shown."""
    plain = {key: value for key, value in result.items() if key not in ("coverage", "out", "to_go")}
    lines = result_lines({**plain, **coverage_told(result["coverage"]), "out": result["out"]})
    to_go = result.get("to_go")
    return [*lines, f"{to_go} to go: the same command with --resume goes on."] if to_go else lines


def import_lines(result: Mapping[str, Any]) -> list[str]:
    """What `import` wrote, and each note with the episodes that it is about."""
    episodes: dict[str, list[str]] = {}
    for id, notes in result["notes"].items():
        for note in notes:
            episodes.setdefault(note, []).append(id)
    lines = result_lines({key: value for key, value in result.items() if key != "notes"})
    for note, ids in episodes.items():
        more = f", and {len(ids) - _NAMED} more" if len(ids) > _NAMED else ""
        who = "all" if len(ids) == result["episodes"] else ", ".join(ids[:_NAMED]) + more
        lines += wrap(f"note ({who}): {note}", 100, subsequent_indent="  ")
    return lines


def process_lines(result: Mapping[str, Any]) -> list[str]:
    """What `process` found: figures, then each kind of defect and warning with its episodes, defects first."""
    found = {key: result[key] for key in ("defects", "warnings")}
    lines = result_lines({key: value for key, value in result.items() if key not in found})
    for severity, kinds in found.items():
        for kind, each in kinds.items():
            more = f", and {len(each['episodes']) - _NAMED} more" if len(each["episodes"]) > _NAMED else ""
            lines.append(f"{severity.removesuffix('s')}: {kind} in {', '.join(each['episodes'][:_NAMED])}{more}")
            lines += wrap(f"such as: {each['evidence']}", 100, initial_indent="  ", subsequent_indent="  ")
    return lines


def analysis_lines(result: Mapping[str, Any]) -> list[str]:
    """What `analyze` found: figures, then how many episodes have each finding."""
    plain = {key: value for key, value in result.items() if key not in ("findings", "page")}
    found = {name: f"{count} episode{'' if count == 1 else 's'}" for name, count in result["findings"].items()}
    return [*result_lines(plain), *result_lines({"findings": found, "page": result["page"]})]


def calibration_lines(result: Mapping[str, Any]) -> list[str]:
    """What `calibrate` found, within what it lies in 95 of 100 cases, and what is true, where a simulation knows."""
    payload, truth = result["payload"], result["truth"]
    com_mm = ["  ".join(f"{1e3 * x:8.2f}" for x in of["com_sensor_m"]) for of in (payload, truth or payload)]
    within_mm = "  ".join(f"{2e3 * std:8.2f}" for std in result["com_std_m"])
    plain = {
        "condition": f"{result['condition']:.1f}, expected less than {result['limits']['max_condition']:g}",
        "left of any rest": f"{result['left_n']:.3f} N, {1e3 * result['left_nm']:.2f} mN.m",
        "rests": f"{result['rests']} in " + ", ".join(source["file"] for source in result["sources"]),
        "sensor": result["sensor"],
        "out": result["out"],
    }
    return [
        f"{'':10}  {'mass g':>8}  centre of mass mm, x y z in the sensor frame",
        f"{'found':10}  {1e3 * payload['mass_kg']:8.2f}  {com_mm[0]}",
        f"{'+- (95 %)':10}  {2e3 * result['mass_std_kg']:8.2f}  {within_mm}",
        *([f"{'true':10}  {1e3 * truth['mass_kg']:8.2f}  {com_mm[1]}"] if truth else []),
        *result_lines(plain),
    ]


def _said(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list | tuple):
        items = [_said(item) for item in value]
        return ("; " if any(" " in item for item in items) else " ").join(items)
    return "none" if value == {} else str(value)


def validation_lines(found: Mapping[str, Any]) -> list[str]:
    """What `validate` says: the verdict, each problem, and how regular each stream is."""
    checked = f": {', '.join(found['checked'])}" if "checked" in found else ""
    lines = [("valid" if found["valid"] else "not valid") + checked, *(f"  {problem}" for problem in found["problems"])]
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
    warnings = f"{counts['warning']} warning{'' if counts['warning'] == 1 else 's'}"
    told = f"{counts['ok']} ok, {warnings}, {counts['missing']} missing"
    stops = [check["name"] for check in checks if check["essential"] and check["state"] == "missing"]
    verdict = f"Not ready to record: {', '.join(stops)}." if stops else "Ready to record: nothing essential is missing."
    return [*lines, "", f"{verdict} {told}."]


def _wrapped(sign: str, text: str) -> list[str]:
    """Lines of at most 88 characters, with a sign before the first."""
    return wrap(text, 88, initial_indent=sign, subsequent_indent="  ", break_on_hyphens=False, break_long_words=False)


def recording_lines(found: Mapping[str, Any]) -> list[str]:
    """What `info` says of a recording: what it is, its topics, how it was recorded, and what is attached to it."""
    about = {
        "id": found["id"],
        "task": found["task"] or None,
        "duration": f"{found['duration_s']:.3f} s",
        "size": f"{found['size_bytes'] / 1e6:.3f} MB",
        "chunks": ", ".join(f"{count} {name}" for name, count in found["chunks"].items()) or None,
        **({"by": _pairs(found["by"])} if found["by"] else {}),
        "result": _pairs(found["result"]),
        **_safety(found["safety"]),
        **_plans(found["plans"]),
    }
    topics = [
        (name, of["schema"] or "-", of["messages"], _rate(of["rate_hz"]), _said(of["gaps"]), _ms(of["longest_pause_s"]))
        for name, of in found["topics"].items()
    ]
    lines = [*result_lines(about), "", *_table("topic|type", "messages|rate|gaps|longest pause", topics)]
    recorded = found["recorded"] if isinstance(found["recorded"], Mapping) else {}
    if all(isinstance(of, Mapping) for of in recorded.values()) and recorded:
        sources = [
            (
                name,
                *(_said(of.get(key)) for key in ("rows", "missing", "dropped", "gaps")),
                _ms(of.get("longest_s")),
                "-" if of.get("jitter_s") is None else f"{of['jitter_s'] * 1e6:.1f} us",
            )
            for name, of in recorded.items()
        ]
        problems = [of["problem"] for of in recorded.values() if "problem" in of]
        lines.append("(rates and pauses above are of when messages were received; below, of when they were sampled)")
        lines += ["", *_table("recorded from", "rows|missing|dropped|gaps|longest pause|jitter", sources), *problems]
    if found["attachments"]:
        attached = [(name, of["media_type"] or "-", of["size_bytes"]) for name, of in found["attachments"].items()]
        lines += ["", *_table("attachment|type", "bytes", attached)]
    return lines


def _safety(said: Any) -> dict[str, str]:
    """What the safety layer did, where a recording says so as ours do: its modes, what intervened, the extremes."""
    try:
        entered = ", ".join(f"{label} ({count})" for label, count in said["entered"].items())
        return {
            "modes": f"{_pairs(said['ticks'])} ticks" + (f"; entered {entered}" if entered else ""),
            "intervened": f"{_pairs(said['interventions'])} ticks" if said["interventions"] else "nothing",
            **({"refused": _pairs(said["refusals"])} if said.get("refusals") else {}),
            "extremes": f"leash in {said['leash_share']:.1%} of the ticks, tank down to {said['tank_min_j']:.2f} J, "
            f"force up to {said['peak_force_n']:.1f} N, moment up to {said['peak_moment_nm']:.2f} N.m",
        }
    except (AttributeError, KeyError, TypeError, ValueError):  # Another writer's, or none.
        return {}


def _plans(said: Any) -> dict[str, str]:
    """What became of a policy's plans, where a recording says so as that of a rollout does."""
    try:
        told = ", ".join(f"{said[fate]} {fate}" for fate in ("sent", "lost", "overtaken", "received"))
        told += f", {sum(said['refused'].values())} refused"
        if said["received"]:
            told += (
                f"; {sum(said['kept'])} waypoints kept, {sum(said['dropped'])} dropped; up to {max(said['age_ticks'])} "
                f"ms old, seams up to {1e3 * max(said['seam_jump_m']):.2f} mm"
            )
        return {"plans": told}
    except (AttributeError, KeyError, TypeError, ValueError):  # Another writer's, or none.
        return {}


def _pairs(value: Any) -> str:
    """A mapping in one line; what is empty is left out."""
    if not isinstance(value, Mapping):
        return _said(value)
    return ", ".join(f"{key} {_said(of)}" for key, of in value.items() if of != "")


def _rate(rate_hz: float | None) -> str:
    return "-" if rate_hz is None else f"{rate_hz:.1f} Hz"


def _ms(time_s: float | None) -> str:
    return "-" if time_s is None else f"{time_s * 1e3:.3f} ms"


def _table(texts: str, numbers: str, rows: Sequence[Sequence[Any]]) -> list[str]:
    """Rows under their heads, which a bar separates: texts to the left, numbers to the right."""
    heads = [*texts.split("|"), *numbers.split("|")]
    said = [heads, *([str(cell) for cell in row] for row in rows)]
    widths = [max(len(row[i]) for row in said) for i in range(len(heads))]
    sides = ["<"] * len(texts.split("|")) + [">"] * len(numbers.split("|"))
    return [
        "  ".join(f"{cell:{side}{width}}" for cell, side, width in zip(row, sides, widths, strict=True)).rstrip()
        for row in said
    ]


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
