"""What the figures mean, and how the episodes were processed: from where both are stated, so that nothing differs."""

from collections.abc import Iterator, Mapping
from html import escape
from itertools import groupby
from typing import Any

from wrenchflow.config import to_mapping
from wrenchflow.pages.page import section, table
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.metric import METRICS
from wrenchflow.process.report.words import prose, with_unit


def meanings_section() -> str:
    """Every metric with its unit and meaning."""
    parts = []
    for group, metrics in groupby(METRICS, key=lambda metric: metric.group):
        items = "".join(
            f"<dt>{escape(with_unit(metric.name))} <code>{escape(metric.name)}</code></dt>"
            f"<dd>{prose(metric.meaning)}</dd>"
            for metric in metrics
        )
        parts.append(f'<details class="group"><summary>{escape(group)}</summary><dl>{items}</dl></details>')
    return section("What the figures mean", *parts)


def processing_section(config: ProcessConfig) -> str:
    """Every setting."""
    rows = [(f"<code>{escape(name)}</code>", escape(_value(value))) for name, value in _flat(to_mapping(config))]
    text = "<p>Settings of wrenchflow process; a name ends in the unit of its value.</p>"
    return section("How it was processed", text, table(("setting", "value"), rows))


def _flat(settings: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{above}{name}.")
        else:
            yield above + name, value


def _value(value: Any) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "not set" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
