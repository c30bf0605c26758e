"""A picture of each task's scene in mid-work, side by side; needs EGL or OSMesa.

Run it as `python benchmarks/task_scenes.py OUT.png`; docs/task-scenes.png is what it writes.
"""

import argparse
import sys
from pathlib import Path

import mujoco
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.session import demonstrate
from wrenchflow.sim.gl import find_gl
from wrenchflow.sim.render import Renderer
from wrenchflow.sim.state import looks_of, set_state
from wrenchflow.sim.tasks import NAMES, scenery

PANEL_PX, HEAD_PX, GAP_PX = (528, 480), 40, 8  # Three panels of 528 pixels are twice what a page shows.
FINER = 2  # Drawn larger and averaged, for the renderer does not smooth edges.
PHASE = {"peg-insertion": "search", "surface-wiping": "wipe", "connector-insertion": "search"}
# Where it is looked from, by the place that is looked at.
FROM_M, ABOVE_M, FOV_DEG = np.array([0.33, -0.40, 0.20]), 0.055, 34.0


def picture_of(task: str, gl: str) -> Image.Image:
    """The scene of episode 0 of seed 0, in the middle of a phase."""
    made, rig, model = scenery(task)
    episode = demonstrate(0, CollectConfig(task=task, operator="emulated", profiles=("steady",)))
    phase = max(
        (event for event in episode.events_of("phase") if event.label == PHASE[task]),
        key=lambda event: event.stop_ns - event.start_ns,
    )
    joints = episode["joint_states"]
    row = np.searchsorted(joints.t, (phase.start_ns + phase.stop_ns) // 2)
    data = mujoco.MjData(model)
    set_state(model, data, np.array(episode.meta["simulator"]["state"]))
    data.qpos[:] = joints.data[row, : model.nq]
    spec = made.make_spec(rig)
    at_m = episode["tcp_pose"].data[row, :3] + [0.0, 0.0, ABOVE_M]
    away = FROM_M / np.linalg.norm(FROM_M)
    right = np.cross([0.0, 0.0, 1.0], away)
    right /= np.linalg.norm(right)
    spec.worldbody.add_camera(name="look", pos=at_m + FROM_M, xyaxes=[*right, *np.cross(away, right)], fovy=FOV_DEG)
    spec.compile()
    renderer = Renderer(spec.to_xml(), gl, *(FINER * pixels for pixels in PANEL_PX))
    renderer.set(looks_of(model, data))
    pixels = renderer.draw("look")
    renderer.close()
    return Image.fromarray(pixels).resize(PANEL_PX, Image.Resampling.BOX)


def main() -> None:
    """Draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("picture", type=Path, help="where the picture goes")
    arguments = parser.parse_args()
    gl = find_gl()
    if gl is None:
        sys.exit("neither EGL nor OSMesa works here")
    width, height = PANEL_PX
    sheet = Image.new("RGB", (len(NAMES) * width + (len(NAMES) - 1) * GAP_PX, HEAD_PX + height), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=26)
    for number, task in enumerate(NAMES):
        left = number * (width + GAP_PX)
        sheet.paste(picture_of(task, gl), (left, HEAD_PX))
        pen.text((left + 2, 2), f"{task}: {PHASE[task]}", fill=(27, 31, 36), font=font)
    sheet.save(arguments.picture, optimize=True)


if __name__ == "__main__":
    main()
