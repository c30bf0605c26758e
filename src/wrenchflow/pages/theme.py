"""Colours, style sheet and plot layout of all pages, light and dark."""

from typing import Any

# Vermillion, green and blue of Okabe and Ito: x, y and z as robotics draws them, and apart for the colour-blind too.
AXIS_COLOURS = ("#d55e00", "#009e73", "#3b8fd9")
# The others of theirs, for lines that are no axes.
COLOURS = (AXIS_COLOURS[2], AXIS_COLOURS[0], AXIS_COLOURS[1], "#cc79a7", "#c99700", "#8a63d2", "#56b4e9", "#7a828c")
ACCENT = "#3b8fd9"
GOOD = "#1a9b5f"
BAD = "#d4462f"
CONTACT = "rgba(230,159,0,0.75)"
CONTACT_MODE = "rgba(86,180,233,0.6)"
CONTACT_SHADE = "rgba(230,159,0,0.13)"
ANOMALY_SHADE = "rgba(212,70,47,0.16)"
PHASE = ("rgba(128,138,150,0.22)", "rgba(128,138,150,0.40)")
PHASE_SHADE = "rgba(128,138,150,0.09)"
# Modes of the safety layer, from the mildest to the last.
_MODES = {"hold": (230, 159, 0), "retreat": (213, 94, 0), "soft-stop": (204, 121, 167), "latched": (212, 70, 47)}
# Grey that can be read on white and on black: what a plot shows before the style sheet has its say.
_NEUTRAL = "#7a828c"
_FONT = "system-ui, Segoe UI, Roboto, Helvetica Neue, Arial, sans-serif"

STYLE = f"""
:root {{ color-scheme: light dark; --text: #1b1f24; --soft: #5b6570; --line: #dfe3e8; --card: #f6f7f9; --back: #ffffff;
  --accent: {ACCENT}; --good: {GOOD}; --bad: {BAD}; --warn: #9a6200; --track: #e6e9ed; }}
@media (prefers-color-scheme: dark) {{ :root {{ --text: #e7eaee; --soft: #9aa5b1; --line: #2f363e; --card: #1c2127;
  --back: #14181c; --track: #2a3138; --good: #3fbf85; --bad: #ef7a63; --warn: #e8b04a; }} }}
* {{ box-sizing: border-box; }}
body {{ font: 16px/1.55 {_FONT}; color: var(--text);
  background: var(--back); margin: 0 auto; max-width: 76rem; padding: 2.2rem 1.5rem 3rem; }}
h1 {{ font-size: 1.8rem; line-height: 1.2; margin: 0 0 .5rem; }}
h2 {{ font-size: 1.2rem; margin: 2.6rem 0 .5rem; }} p {{ margin: .5rem 0; max-width: 52rem; }}
a {{ color: var(--accent); }} small, .soft {{ color: var(--soft); }}
code, pre {{ font: .88em/1.5 ui-monospace, "SFMono-Regular", Menlo, Consolas, monospace; }}
pre {{ background: var(--card); border: 1px solid var(--line); border-radius: 6px; margin: .3rem 0 .9rem;
  overflow-x: auto; padding: .5rem .8rem; }}
.cards {{ display: grid; gap: .8rem; grid-template-columns: repeat(auto-fit, minmax(15rem, 1fr)); margin: 1.4rem 0; }}
@media (max-width: 64rem) {{ .cards {{ grid-template-columns: 1fr 1fr; }} }}
.card {{ background: var(--card); border: 1px solid var(--line); border-radius: 8px; padding: .8rem 1.1rem; }}
.card b {{ display: block; font-size: 2.1rem; line-height: 1.25; }} .card span {{ color: var(--soft); display: block; }}
.scroll {{ overflow-x: auto; }}
table {{ border-collapse: collapse; font-variant-numeric: tabular-nums; margin: .6rem 0; }}
table.wide {{ width: 100%; }} th, td {{ border-bottom: 1px solid var(--line); padding: .42rem .9rem .42rem 0;
  text-align: right; vertical-align: middle; }}
th {{ color: var(--soft); font-size: .88rem; font-weight: 600; white-space: nowrap; }}
td:first-child, th:first-child {{ text-align: left; }} td small {{ display: block; line-height: 1.35; }}
table.wide th:last-child {{ text-align: left; }}
td.figure {{ white-space: nowrap; }} td.bar {{ padding-right: 0; width: 42%; }}
tr.main td {{ font-weight: 600; }} tr.main small {{ font-weight: 400; }}
svg.bar {{ display: block; height: 18px; width: 100%; }} svg.bar .track {{ fill: var(--track); }}
svg.bar .fill {{ fill: var(--soft); opacity: .55; }} svg.bar .fill.main {{ fill: var(--accent); opacity: .85; }}
svg.bar line {{ stroke: var(--text); stroke-width: 1.5; vector-effect: non-scaling-stroke; }}
details {{ border: 1px solid var(--line); border-radius: 8px; margin: .6rem 0; }}
summary {{ background: var(--card); border-radius: 8px; cursor: pointer; padding: .5rem .9rem; }}
summary .soft {{ margin-left: .6rem; }} details > div, details > p {{ margin: .5rem .9rem; }}
.good {{ color: var(--good); font-weight: 600; }} .bad {{ color: var(--bad); font-weight: 600; }}
dt {{ font-weight: 600; margin-top: .5rem; }} dd {{ margin: 0; max-width: 52rem; }}
ul {{ margin: .4rem 0; padding-left: 1.2rem; }}
footer {{ border-top: 1px solid var(--line); color: var(--soft); font-size: .88rem; margin-top: 3rem;
  padding-top: .8rem; }}
section h3 {{ font-size: 1rem; margin: 1.4rem 0 .2rem; }}
.defect {{ color: var(--bad); font-weight: 600; }} .warning {{ color: var(--warn); font-weight: 600; }}
.note {{ color: var(--soft); font-weight: 600; }} .text {{ text-align: left !important; }}
nav {{ display: flex; flex-wrap: wrap; gap: .3rem 1.1rem; margin: 1rem 0; }}
nav.contents {{ background: var(--back); border-bottom: 1px solid var(--line); padding: .5rem 0; position: sticky;
  top: 0; z-index: 2; }}
main > div[id] {{ scroll-margin-top: 3rem; }}
.group table {{ width: 100%; }} .group th {{ text-align: left; }} .group td {{ text-align: left; vertical-align: top; }}
.group td:last-child {{ overflow-wrap: anywhere; }} .group td {{ min-width: 5.5rem; }}
.group td.text {{ min-width: 14rem; }} .group dl {{ margin: .5rem .9rem; }}
summary, h1, td a, dd, li {{ overflow-wrap: anywhere; }}
.compared th {{ vertical-align: bottom; white-space: normal; }} .compared td:first-child {{ min-width: 13rem; }}
ul.names {{ columns: 16rem; margin: .4rem .9rem .8rem; }}
.strips {{ display: grid; gap: .35rem 2rem; grid-template-columns: repeat(auto-fit, minmax(min(26rem, 100%), 1fr)); }}
.strip > div {{ display: flex; flex-wrap: wrap; gap: 0 .7rem; align-items: baseline; }}
.strip small {{ font-variant-numeric: tabular-nums; }}
.strip svg {{ border-bottom: 1px solid var(--line); display: block; height: 44px; width: 100%; }}
.box {{ fill: var(--track); }} .median {{ stroke: var(--text); stroke-width: 1.6; }}
.dot {{ fill: var(--accent); fill-opacity: .55; }} .dot-defect {{ fill: {AXIS_COLOURS[0]}; fill-opacity: .9; }}
.lit use {{ fill: var(--text); fill-opacity: 1; stroke: var(--back); stroke-width: 1.5; }}
.marks {{ position: absolute; }}
.tip {{ background: var(--text); border-radius: 5px; color: var(--back); font-size: .85rem; max-width: 95vw;
  padding: .15rem .5rem; pointer-events: none; position: fixed; z-index: 3; }}
.pair {{ display: grid; gap: 1rem; grid-template-columns: 3fr 2fr; }} .pair > :only-child {{ grid-column: 1 / -1; }}
figure {{ margin: 0; min-width: 0; }} figcaption {{ color: var(--soft); font-size: .88rem; }}
@media (max-width: 56rem) {{ .pair {{ grid-template-columns: 1fr; }} }}
.tools {{ align-items: center; display: flex; flex-wrap: wrap; gap: .4rem 1.4rem; }}
input[type=search] {{ background: var(--card); border: 1px solid var(--line); border-radius: 6px; color: inherit;
  font: inherit; max-width: 100%; padding: .2rem .5rem; width: 16rem; }}
.episodes {{ font-size: .9rem; }} .episodes td, .episodes th {{ white-space: nowrap; }}
.episodes td {{ padding: .25rem 1.2rem .25rem 0; }} .scroll:has(.episodes) {{ max-height: 85vh; overflow: auto; }}
.episodes thead th {{ background: var(--back); position: sticky; top: 0; z-index: 1; }}
.episodes thead th:first-child {{ z-index: 2; }}
.episodes th {{ padding-right: 1.2rem; vertical-align: bottom; }} .episodes th:nth-child(-n+5) {{ text-align: left; }}
.episodes th button {{ background: none; border: 0; color: inherit; cursor: pointer; font: inherit; padding: 0;
  text-align: inherit; }} .episodes th small {{ display: block; font-weight: 400; min-height: 1.2em; }}
[aria-sort=ascending] button::after {{ content: " ↑"; }} [aria-sort=descending] button::after {{ content: " ↓"; }}
.episodes td:first-child, .episodes th:first-child {{ background: var(--back); left: 0; position: sticky; }}
svg.steps {{ background: var(--track); height: 24px; width: 10rem; }} svg.steps rect {{ fill: var(--accent); }}
svg.share {{ display: block; height: 5px; width: 100%; }} svg.share rect {{ fill: var(--accent); opacity: .7; }}
:focus-visible {{ outline: 2px solid var(--accent); outline-offset: 2px; }}
@media (max-width: 40rem) {{ body {{ padding: 1.2rem .9rem 2rem; }} .cards {{ gap: .5rem; }}
  .card {{ padding: .5rem .7rem; }} .card b {{ font-size: 1.5rem; }}
  nav.contents {{ flex-wrap: nowrap; overflow-x: auto; white-space: nowrap; }}
  .group thead {{ display: none; }} .group tr {{ border-bottom: 1px solid var(--line); display: flex; flex-wrap: wrap;
  gap: .1rem .9rem; padding: .4rem 0; }} .group td, .group td.text {{ border: 0; min-width: 0; padding: 0; }}
  .group td:first-child, .group td:last-child {{ flex-basis: 100%; }}
  .episodes td:first-child {{ max-width: 9rem; overflow: hidden; text-overflow: ellipsis; }} }}
@media print {{ :root {{ color-scheme: light; --text: #000; --soft: #444; --line: #bbb; --card: #fff; --back: #fff;
  --track: #e6e9ed; --good: #0f6b3c; --bad: #a92d18; --warn: #7a4e00; }}
  body {{ font-size: 10pt; max-width: none; padding: 0; }} nav, .tools, .tip {{ display: none; }}
  .card, tr, figure, .strip, .plot {{ break-inside: avoid; }} h2, h3, summary {{ break-after: avoid; }}
  .scroll {{ overflow: visible; max-height: none !important; }} .episodes {{ font-size: 5.6pt; }}
  .episodes td:nth-child(-n+4) {{ overflow-wrap: anywhere; }}
  .episodes td, .episodes th {{ padding: .1rem .2rem !important; position: static !important;
  white-space: normal; }} a {{ color: inherit; text-decoration: none; }}
  table {{ font-size: 8pt; }} th {{ font-size: inherit; white-space: normal !important; }}
  small {{ font-size: inherit; }}
  .plot {{ overflow: hidden; }} .pair {{ grid-template-columns: 1fr; }} }}
.plot .xtick text, .plot .ytick text, .plot .xtitle, .plot .ytitle {{ fill: var(--soft) !important; }}
.plot .annotation-text, .plot .legendtext, .plot .bartext {{ fill: var(--text) !important; }}
.plot .gridlayer path {{ stroke: var(--line) !important; }}
.plot .hoverlayer .legend .bg {{ fill: var(--card) !important; stroke: var(--line) !important;
  fill-opacity: .94 !important; }}
"""


def mode_colour(label: str, opacity: float) -> str:
    """Colour of a mode, by its label such as `hold: silence`; grey for one that is not known here."""
    red, green, blue = _MODES.get(label.partition(":")[0], (128, 138, 150))
    return f"rgba({red},{green},{blue},{opacity:g})"


def plot_layout(plot_px: int, *, top_px: int = 24, **others: Any) -> dict[str, Any]:
    """Layout that every plot starts from: no background of its own, and as wide as the page lets it be.

    Args:
        plot_px: Height of the plot between its margins [px].
        top_px: Height of the margin above [px].
        **others: Entries of the layout of a plotly figure, in addition.
    """
    return {
        "template": "none",
        "autosize": True,
        "height": top_px + plot_px + 44,
        "margin": {"l": 56, "r": 12, "t": top_px, "b": 44},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": _FONT, "size": 12, "color": _NEUTRAL},
        "hoverlabel": {"font": {"size": 12}},
        **others,
    }
