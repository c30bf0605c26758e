"""Renders a tiny scene without a screen and says how long a picture takes; `wrenchflow doctor` runs it as a program."""

import json
import statistics
import sys
import time

import mujoco

_SIZE, _FRAMES = 224, 20
_SCENE = """
<mujoco>
  <worldbody>
    <light pos="0 0 3"/>
    <geom type="plane" size="1 1 0.1" rgba="0.2 0.3 0.4 1"/>
    <geom type="box" size="0.1 0.1 0.1" pos="0 0 0.1" rgba="0.9 0.5 0.1 1"/>
  </worldbody>
</mujoco>
"""


def probe() -> dict[str, float | str]:
    """Render a picture some times.

    Returns:
        `frame_s`, the median time that one took after the first [s], and `renderer`, what drew it.

    Raises:
        RuntimeError: If the picture shows nothing.
    """
    model = mujoco.MjModel.from_xml_string(_SCENE)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    taken_s = []
    with mujoco.Renderer(model, _SIZE, _SIZE) as renderer:
        for _ in range(_FRAMES + 1):
            start_s = time.perf_counter()
            renderer.update_scene(data)
            picture = renderer.render()
            taken_s.append(time.perf_counter() - start_s)
        if picture.std() < 1.0:
            raise RuntimeError("the picture is empty")
        from OpenGL import GL  # Only now: MuJoCo has told it which library to take.

        name = GL.glGetString(GL.GL_RENDERER)
    return {"frame_s": statistics.median(taken_s[1:]), "renderer": (name or b"an unknown renderer").decode()}


if __name__ == "__main__":
    sys.stdout.write(json.dumps(probe()) + "\n")
