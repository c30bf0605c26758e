"""The page that a person opens after `process`: one row an episode, and what each figure means. Needs no network."""

from collections.abc import Sequence
from html import escape

import numpy as np

from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.quality import Quality

NOT_ASSESSED = "not assessed"

_STYLE = """
:root { color-scheme: light dark; --line: color-mix(in srgb, currentColor 18%, transparent); }
body { font: 15px/1.5 system-ui, sans-serif; margin: 2.5rem auto; max-width: 76rem; padding: 0 1.5rem; }
h1 { font-size: 1.5rem; margin: 0; } h2 { font-size: 1.05rem; margin: 2.2rem 0 .4rem; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .8rem; text-align: right; border-bottom: 1px solid var(--line); white-space: nowrap; }
th { font-weight: 600; vertical-align: bottom; } th small { display: block; font-weight: 400; opacity: .7; }
td:first-child, th:first-child, .text { text-align: left; } .muted { opacity: .6; } .bad { color: #c2410c; }
dt { font-weight: 600; } dd { margin: 0 0 .5rem; max-width: 60rem; }
"""

_HEAD = (
    ("episode", ""),
    ("outcome", ""),
    ("duration", "s"),
    ("contact", "% of samples"),
    ("contacts", ""),
    ("max_force", "N"),
    ("snr, force", "dB"),
    ("snr, moment", "dB"),
    ("smoothness", "N a sample"),
    ("bias", "N | N.m"),
)


def report_page(qualities: Sequence[Quality], config: ProcessConfig) -> str:
    """The whole page.

    Args:
        qualities: Figures of each episode.
        config: How they were processed.
    """
    head = "".join(f"<th>{name}<small>{unit}</small></th>" for name, unit in _HEAD)
    rows = "\n".join(_row(quality) for quality in qualities)
    contact, bias = config.contact, config.bias
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width">
<title>Force quality of {len(qualities)} episodes</title><style>{_STYLE}</style></head><body>
<h1>Force quality</h1>
<p>{_summary(qualities)}</p>
<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>
{rows}
</tbody></table></div>
<h2>What the figures mean</h2>
<dl>
<dt>max_force</dt><dd>Largest norm of the force in <code>wrench</code>: without bias and weight, through the causal
low-pass of {config.cutoff_hz:g} Hz that deployment runs. It is the figure that a force limit sees.</dd>
<dt>snr</dt><dd>Root mean square in contact over that in free motion, of <code>wrench_zero_phase</code>. Forces and
moments are never averaged together; <code>quality.parquet</code> has every axis.</dd>
<dt>smoothness</dt><dd>Mean norm of the change of force from one sample to the next; lower is smoother.</dd>
<dt>contact</dt><dd>Begins where the force norm reaches {contact.on_n:g} N, ends where it falls below
{contact.off_n:g} N; contacts and breaks shorter than {contact.min_dwell_s:g} s do not count.</dd>
<dt>bias</dt><dd>Mean reading of the sensor at rest without contact, weight of the payload taken out. A window is
refused when a joint is faster than {bias.max_joint_velocity_rad_s:g} rad/s, the reading spreads or drifts by more than
{bias.max_spread:g} or {bias.max_drift:g} times the sensor's noise, or more than {bias.max_force_n:g} N are left on an
axis.</dd>
</dl>
</body></html>
"""


def _summary(qualities: Sequence[Quality]) -> str:
    seconds = sum(quality.duration_s for quality in qualities)
    samples = sum(quality.samples for quality in qualities)
    touching = sum(quality.has_contact for quality in qualities)
    known = [quality.success for quality in qualities if quality.success is not None]
    peak_n = np.median([quality.max_force for quality in qualities]) if qualities else 0.0
    outcome = f"{sum(known)} of {len(known)} succeeded" if known else "outcome not recorded"
    return (
        f"{len(qualities)} episodes, {seconds:.1f} s, {samples} samples. {outcome}; {touching} have contact; "
        f"the median of their largest forces is {peak_n:.1f} N."
    )


def _row(quality: Quality) -> str:
    outcome = {True: "success", False: '<span class="bad">failure</span>', None: _missing("the recording does not say")}
    contact = f"{100 * quality.contact_fraction:.1f}" if quality.has_contact else '<span class="bad">no contact</span>'
    cells = (
        escape(quality.id),
        outcome[quality.success],
        f"{quality.duration_s:.2f}",
        contact,
        f"{quality.contacts}",
        f"{quality.max_force:.2f}",
        *(
            _missing(quality.not_assessed) if value is None else f"{value:.1f}"
            for value in (quality.snr_force_db, quality.snr_torque_db)
        ),
        f"{quality.smoothness:.4f}",
        " | ".join(
            " ".join(f"{value:.{digits}f}" for value in part)
            for part, digits in ((quality.bias[:3], 2), (quality.bias[3:], 3))
            if part
        ),
    )
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"


def _missing(reason: str) -> str:
    return f'<span class="muted" title="{escape(reason)}">{NOT_ASSESSED}: {escape(reason)}</span>'
