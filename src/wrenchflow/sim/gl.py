"""Which of MuJoCo's ways to draw without a screen works on this machine: EGL, or else OSMesa.

    python -m wrenchflow.sim.gl egl

draws some pictures, prints as JSON how long one takes and what drew it, and ends with 0 where that worked. Each way is
tried in a process of its own: a broken driver may end the process, and a library that was loaded for one way cannot be
taken back for the other.
"""

import importlib
import json
import os
import statistics
import subprocess
import sys
import time
from functools import cache
from typing import Any

from wrenchflow.sim import ASKED_GL

WAYS = ("egl", "osmesa")
PACKAGES = "libegl1 and libgl1-mesa-dri, or libosmesa6"  # Debian's names.
_PATIENCE_S = 60.0
_PIXELS, _PICTURES = 224, 10


@cache
def find_gl() -> str | None:
    """The first way that works, or None; what MUJOCO_GL names is tried first."""
    ways = sorted(WAYS, key=lambda way: way != ASKED_GL)
    return next((way for way in ways if can_draw(way)), None)


def can_draw(way: str) -> bool:
    """Whether a small picture can be drawn in this way; takes a second."""
    try:
        tried = subprocess.run(
            [sys.executable, "-m", "wrenchflow.sim.gl", way], capture_output=True, timeout=_PATIENCE_S, check=False
        )
    except subprocess.TimeoutExpired:
        return False
    return tried.returncode == 0


def make_context(way: str, width: int, height: int) -> Any:
    """An OpenGL context of a way that works, current in this thread."""
    os.environ["MUJOCO_GL"] = way  # MuJoCo loads the libraries of this one, where it has not been loaded yet.
    context = importlib.import_module(f"mujoco.{way}").GLContext(width, height)
    context.make_current()
    return context


def _try(way: str) -> int:
    os.environ["MUJOCO_GL"] = way

    try:
        from wrenchflow.sim.render import Renderer
    except AttributeError:  # PyOpenGL's word for a library that is not there.
        print(f"the library of {way.upper()} is not installed", file=sys.stderr)
        return 1
    world = "<light pos='0 0 3'/><geom size='1'/><camera name='eye' pos='0 0 3'/>"
    renderer = Renderer(f"<mujoco><worldbody>{world}</worldbody></mujoco>", way, _PIXELS, _PIXELS)
    taken_s = []
    for _ in range(_PICTURES + 1):
        start_s = time.perf_counter()
        pixels = renderer.draw("eye")
        taken_s.append(time.perf_counter() - start_s)
    from OpenGL import GL  # Only now: MuJoCo has told it which library to take.

    drawn_by = (GL.glGetString(GL.GL_RENDERER) or b"an unknown renderer").decode()
    renderer.close()
    if pixels.max() == pixels.min():
        print("the picture is empty", file=sys.stderr)
        return 1
    print(json.dumps({"frame_s": statistics.median(taken_s[1:]), "renderer": drawn_by}))
    return 0


if __name__ == "__main__":
    sys.exit(_try(sys.argv[1]))
