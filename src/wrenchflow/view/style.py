"""How things look: names, units and colours of the plots and lanes, and what marks the poses in space."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
from jaxtyping import Float

from wrenchflow.episode import Event
from wrenchflow.view.contents import FORCE_AS_READ, WORLD, Contents

ARROW_M_PER_N = 0.01

_Colour = tuple[int, int, int]
# Vermillion, green and blue of Okabe and Ito for x, y and z, and all of theirs for joints.
_XYZ: tuple[_Colour, ...] = ((213, 94, 0), (0, 158, 115), (59, 143, 217))
_MANY: tuple[_Colour, ...] = ((230, 159, 0), (86, 180, 233), (204, 121, 167), (240, 228, 66), *_XYZ)
_GREY: _Colour = (150, 158, 168)
_FORCE: _Colour = (240, 200, 60)
_MARKS: dict[str, _Colour] = {"target_pose": (204, 121, 167), "command_pose": (86, 180, 233)}
_BODY_AXES_M, _GOAL_AXES_M = 0.06, 0.03
_PHASES: tuple[_Colour, ...] = ((62, 72, 84), (86, 104, 126), (74, 98, 92), (104, 92, 112), (98, 96, 78))
_STATES: dict[str, _Colour] = {
    "contact": (230, 159, 0),
    "success": (26, 155, 95),
    "failure": (212, 70, 47),
    "anomaly": (212, 70, 47),
    # Of the safety layer, by the first word of the label, such as `hold: silence`.
    "hold": (200, 140, 20),
    "retreat": (213, 94, 0),
    "soft-stop": (190, 100, 150),
    "latched": (212, 70, 47),
    "refused": (150, 158, 168),
}


def log_styles(recording: rr.RecordingStream, contents: Contents) -> None:
    """Log what does not change, once."""
    recording.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for series in contents.series:
        palette = _XYZ if len(series.columns) == 3 else _MANY
        colours = [palette[k % len(palette)] for k in range(len(series.columns))]
        style = rr.SeriesLines(
            names=series.names,
            colors=[_paler(colour) for colour in colours] if series.is_beside else colours,
            widths=[1.0 if series.is_beside else 1.6] * len(colours),
        )
        recording.log(series.entity, style, static=True)
    for name in contents.poses:
        recording.log(f"{WORLD}/{name}", _mark(name, name == contents.body), static=True)
    if contents.arrow is not None:
        arrow = rr.Arrows3D.from_fields(colors=[_FORCE], radii=[0.002])
        recording.log(contents.arrow_entity, arrow, static=True)
    if contents.arrow_entity == FORCE_AS_READ and contents.T_tcp_sensor is not None:
        # In the sensor's axes, but drawn at the tcp, where the contact is.
        qw, qx, qy, qz = contents.T_tcp_sensor[3:].tolist()
        mount = rr.Transform3D(quaternion=rr.Quaternion(xyzw=[qx, qy, qz, qw]))
        recording.log(contents.arrow_entity, mount, static=True)


def path_of(positions_m: Float[np.ndarray, "n 3"]) -> rr.LineStrips3D:
    """A path in space [m]. Shape (n, 3)."""
    return rr.LineStrips3D([positions_m], colors=[_GREY], radii=rr.Radius.ui_points([1.0]))


def states_of(kind: str, events: Sequence[Event]) -> rr.StateConfiguration:
    """Colours of a lane's states: one a kind or a label that has a meaning of its own, or else one a label."""
    values = list(dict.fromkeys(event.label or kind for event in events))
    meant = [_STATES.get(kind) or _STATES.get(value.partition(":")[0]) for value in values]
    colours = [colour or _PHASES[k % len(_PHASES)] for k, colour in enumerate(meant)]
    return rr.StateConfiguration(values=values, labels=values, colors=colours)


def _mark(name: str, is_body: bool) -> rr.AsComponents:
    if is_body or name == "goal_pose":
        return rr.TransformAxes3D(_BODY_AXES_M if is_body else _GOAL_AXES_M)
    colour = _MARKS.get(name, _GREY)
    return rr.Points3D([[0, 0, 0]], radii=[0.003], colors=[colour], labels=[name], show_labels=False)


def _paler(colour: _Colour) -> _Colour:
    red, green, blue = ((value + 255) // 2 for value in colour)
    return red, green, blue
