"""What the report calls things, and what it says is to be done about them. What it is handed as text it escapes."""

import math
import re
from html import escape
from types import MappingProxyType

from wrenchflow.pages.page import NBSP
from wrenchflow.process.assessment import Assessment
from wrenchflow.process.finding import Severity
from wrenchflow.process.metric import METRICS, Metric, Value, metric_of

NOT_ASSESSED = "not assessed"
# A sign beside each colour, for who cannot tell the colours apart or prints without them.
SIGNS: MappingProxyType[Severity, str] = MappingProxyType({"defect": "✖", "warning": "▲", "note": "●"})
_TITLES = {metric.name: metric.title for metric in METRICS}

# What to do about each kind of finding. A kind that is not here is shown all the same, with `_LOOK`.
ADVICE = MappingProxyType(
    {
        "unreadable": "Copy the file again from where it was recorded; wrenchflow recover saves what is whole in a "
        "recording that was cut off.",
        "no-clean-force": "Mend what the evidence names and run process again; until then the recording is left out "
        "of the clean ones.",
        "always-loaded": "Record some rest without contact before each demonstration; without it no force of this "
        "recording can be believed further than its bias, which nobody knows.",
        "no-contact": "See in the plot whether the tool touched anything at all. If it did, the thresholds of contact "
        "are too high for this force; if the task has no contact, say so with expects_contact = false.",
        "implausible": "Put the right unit into the mapping, or the sensor's true range into the rig: no sensor reads "
        "that far.",
        "wrong-sign": "Turn the sign of the force around in the mapping or the rig: a wrench is what the robot exerts "
        "on its environment.",
        "wrong-frame": "Check how the sensor is mounted (T_flange_sensor in the rig) against the arm: its axes are "
        "turned from those that the joints speak of.",
        "wrong-payload": "Identify the payload anew with wrenchflow calibrate, and put its mass and centre into the "
        "rig.",
        "drift": "Let the sensor warm up before a session, tare before each episode, and keep episodes short.",
        "duplicate-column": "Check the cabling and the columns of the mapping: two channels carry the same signal.",
        "jump": "See whether the sensor was tared, or its driver restarted, in the middle of the recording.",
        "quaternion-flip": "Nothing is wrong with the pose, but whoever interpolates it must make the sign steady "
        "first.",
        "saturation": "Press less hard, or take a sensor with a wider range. What was beyond the range is lost, and "
        "all figures of the force are too small there.",
        "spike": "Check cable, shield and ground of the sensor; a median of three samples before the filter takes "
        "single spikes out.",
        "stuck": "Check the sensor's driver: its reading froze while the robot moved.",
        "repeated": "The sensor is slower than it is recorded. Record it at its own rate.",
        "constant": "Check that this channel is connected and recorded at all.",
        "dropout": "Look for a busy computer or network during the recording; nothing is known within the gap.",
        "uneven": "Stamp samples where they are measured, not where they arrive; or resample on purpose.",
        "not-finite": "Find out where the driver writes NaN or infinity; these samples are left out.",
        "vibration": "Look for what shakes at this frequency: a loose tool, a fan, a controller that is too stiff.",
    }
)
_NAME = re.compile("`([^`]+)`")
_NUMBER = re.compile(r"[-+]?\d[\d.,]*(?:e[-+]?\d+)?")
_LOOK = "Look at it in the plot of the episode."


def advice(kind: str) -> str:
    """What to do about a kind of finding."""
    return ADVICE.get(kind, _LOOK)


def name_of(kind: str) -> str:
    """What is meant by a kind of finding, or by a metric's name; plain text."""
    return _TITLES.get(kind, kind.replace("-", " ").replace("_", " "))


def sign(severity: Severity, text: str = "") -> str:
    """A severity with its sign, never by its colour alone; HTML."""
    return f'<span class="{severity}">{SIGNS[severity]}{NBSP}{escape(text or severity)}</span>'


def count(number: int, noun: str) -> str:
    """A number with its noun, as `3 defects`."""
    return f"{number:,}{NBSP}{noun}{'' if number == 1 else 's'}"


def verdict(assessment: Assessment) -> str:
    """What is wrong with an episode, in a few words; HTML."""
    defects, warnings = assessment.count("defect"), assessment.count("warning")
    said = [sign("defect", count(defects, "defect"))] if defects else []
    said += [sign("warning", count(warnings, "warning"))] if warnings else []
    return ", ".join(said) or '<span class="good">✓\u00a0sound</span>'


def outcome(success: bool | None) -> str:
    """What a recording says came of it; HTML."""
    if success is None:
        return '<span class="soft">not recorded</span>'
    return '<span class="good">✓\u00a0success</span>' if success else '<span class="bad">✖\u00a0failure</span>'


def figure(metric: Metric, value: Value, *, unit: bool = True) -> str:
    """A metric's value as text; `not assessed` for None, and for what is beyond any number."""
    if value is None or not math.isfinite(value):
        return NOT_ASSESSED
    if isinstance(value, bool):
        return "yes" if value else "no"
    # A value that its digits would show as zero, or that is huge, is shown as it is.
    plain = f"{value:,.{metric.digits}f}" if value else "0"
    if isinstance(value, float) and value and (abs(value) >= 1e6 or not plain.strip("-0.,")):
        plain = f"{value:.2g}"
    return f"{plain}{NBSP}{metric.unit}" if unit and metric.unit else plain


def prose(text: str) -> str:
    """Plain text as HTML; what stands between backticks is a name in code."""
    return _NAME.sub(r"<code>\1</code>", escape(text))


def gist(reason: str) -> str:
    """A reason without its details."""
    return reason.partition(": ")[0]


def without_numbers(text: str) -> str:
    """A text that is the same for all that differ in their numbers alone."""
    return _NUMBER.sub("#", text)


def kind_of_reason(reason: str) -> str:
    """What reasons share that are told together."""
    return without_numbers(gist(reason))


def with_unit(name: str) -> str:
    """A metric's title and unit."""
    metric = metric_of(name)
    return f"{metric.title} [{metric.unit}]" if metric.unit else metric.title
