"""The frame of a page and its small pieces: cards, tables, links. Text that is handed in is escaped here."""

import base64
import hashlib
from collections.abc import Mapping, Sequence
from functools import cache
from html import escape
from typing import Any
from urllib.parse import quote

from wrenchflow.pages.plot_block import DRAW, plot_library
from wrenchflow.pages.theme import STYLE

NBSP = "\u00a0"  # A value and its unit stay on one line.


def page(title: str, sections: Sequence[str], footer: str, *, library: str = "", script: str = "") -> str:
    """A whole HTML document that needs no network.

    Args:
        title: Plain text.
        sections: HTML.
        footer: HTML.
        library: Relative path of the plotting library's script, for pages that share it; else the page carries it.
        script: What the page runs besides drawing its plots.
    """
    body = "\n".join(part for part in sections if part)
    scripts = [DRAW, *([script] if script else [])]
    held = f'<script type="text/plain" class="library" data-path="{escape(address(library))}"></script>'
    if not library:
        held = f'<script type="text/plain" class="library">{plot_library()}</script>'
    inline = "\n".join(f"<script>{each}</script>" for each in scripts)
    allowed = [*([] if library else [plot_library()]), *scripts]
    html = f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="{_policy(allowed, beside=bool(library))}">
<link rel="icon" href="data:,"><title>{escape(title)}</title><style>{STYLE}</style></head><body>
<noscript><p class="bad">The plots on this page are drawn by a script within it; this browser runs none. The tables are
complete.</p></noscript>
<main>
{body}
</main>
<footer>{footer}</footer>
{held}
{inline}
</body></html>
"""
    # A file name may hold bytes that are no text; they are shown as a question mark.
    return html.encode("utf-8", "replace").decode()


def _policy(scripts: Sequence[str], *, beside: bool) -> str:
    """What the browser itself holds: it runs these scripts and no other, and refuses what would need a network.

    A file that is opened from a disk has no origin that `'self'` could mean, but it has a scheme.
    """
    allowed = " ".join([*map(_fingerprint, scripts), *(("'self'", "file:") if beside else ())])
    return f"default-src 'none'; script-src {allowed}; style-src 'unsafe-inline'; img-src data: blob:"


@cache
def _fingerprint(script: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()}'"


def section(title: str, *pieces: str) -> str:
    """A heading (plain text) and the HTML below it."""
    return f"<section><h2>{escape(title)}</h2>\n" + "\n".join(piece for piece in pieces if piece) + "</section>"


def card(label: str, figure: str, detail: str) -> str:
    """One figure in large type, with what it is above and more about it below; all plain text."""
    return f'<div class="card"><span>{escape(label)}</span><b>{escape(figure)}</b><span>{escape(detail)}</span></div>'


def cards(*each: str) -> str:
    """Cards side by side."""
    return f'<div class="cards">{"".join(each)}</div>'


def link(text: str, path: str) -> str:
    """A link to a file beside the page, by its relative path; an address of any other kind is not one."""
    return f'<a href="{escape(address(path))}">{escape(text)}</a>'


def address(path: str) -> str:
    """A relative path as an address; it is never one of another kind, whatever its letters are."""
    return quote(path, errors="surrogateescape")


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, wide: bool = False, main: int | None = None) -> str:
    """A table.

    Args:
        head: Plain text, one a column.
        rows: HTML of each cell; one that begins with `<td` is whole.
        wide: Whether it takes the page's whole width.
        main: The row that matters most.
    """
    columns = "".join(f"<th>{escape(name)}</th>" for name in head)
    lines = "\n".join(
        ('<tr class="main">' if number == main else "<tr>")
        + "".join(cell if cell.startswith("<td") else f"<td>{cell}</td>" for cell in row)
        + "</tr>"
        for number, row in enumerate(rows)
    )
    size = ' class="wide"' if wide else ""
    return f'<div class="scroll"><table{size}><thead><tr>{columns}</tr></thead>\n<tbody>{lines}</tbody></table></div>'


def bar(share: float, label: str, *, interval: tuple[float, float] | None = None, main: bool = False) -> str:
    """A cell with a bar from 0 to 1, and whiskers where an interval is known.

    Args:
        share: Length of the bar, from 0 to 1.
        label: What the bar says, for who cannot see it.
        interval: Ends of the whiskers, from 0 to 1.
        main: Whether this is the bar that matters most.
    """
    kind = "fill main" if main else "fill"
    marks = ""
    if interval:
        low, high = (100.0 * end for end in interval)
        marks = "".join(
            f'<line x1="{x1:.2f}" x2="{x2:.2f}" y1="{y1}" y2="{y2}"/>'
            for x1, x2, y1, y2 in ((low, high, 9, 9), (low, low, 4, 14), (high, high, 4, 14))
        )
    return (
        f'<td class="bar"><svg class="bar" viewBox="0 0 100 18" preserveAspectRatio="none" role="img" '
        f'aria-label="{escape(label)}"><rect class="track" width="100" height="18"/>'
        f'<rect class="{kind}" width="{100.0 * share:.2f}" height="18"/>{marks}</svg></td>'
    )


def amount(value: float | None, digits: int, unit: str = "") -> str:
    """A value with its unit, or what stands where there is none."""
    return "not assessed" if value is None else f"{value:,.{digits}f}" + (f"{NBSP}{unit}" if unit else "")


def percent(rate: float) -> str:
    """A rate between 0 and 1, in percent."""
    return f"{100.0 * rate:.1f}{NBSP}%"


def between(interval: Sequence[float]) -> str:
    """An interval of rates, in percent."""
    return f"{100.0 * interval[0]:.1f} to {100.0 * interval[1]:.1f}{NBSP}%"


def chance(p_value: float) -> str:
    """How likely chance alone would make such a difference."""
    return f"p = {p_value:.3f}" if p_value >= 0.001 else "p < 0.001"


def footer_line(summary: Mapping[str, Any]) -> str:
    """Seed and versions, as far as the summary has them."""
    parts = [f"seed {summary['seed']}"] if "seed" in summary else []
    parts += [f"{name} {version}" for name, version in summary.get("versions", {}).items()]
    return escape(" · ".join(parts))
