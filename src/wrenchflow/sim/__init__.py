"""The simulator. MuJoCo loads the library that MUJOCO_GL names as soon as it is imported, and ends where that is not
there; so the name is taken aside here, before that, for `gl.find_gl`, which tries it when somebody wants a picture.
"""

import os

ASKED_GL = os.environ.pop("MUJOCO_GL", "").lower()
