"""Pictures of a simulated scene, drawn without a screen."""

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from wrenchflow.errors import CameraError
from wrenchflow.sim.gl import make_context
from wrenchflow.sim.state import set_looks

_MAX_GEOMS = 2000


class Renderer:
    """Draws one model from its cameras; belongs to the thread that made it."""

    def __init__(self, mjcf: str, gl: str, width: int, height: int) -> None:
        """Open a context that no window belongs to.

        Args:
            mjcf: The model.
            gl: A way that `gl.find_gl` found.
            width: Of a picture [pixels].
            height: Of a picture [pixels].

        Raises:
            CameraError: If there is no such context to be had.
        """
        self._model = mujoco.MjModel.from_xml_string(mjcf)
        self._model.vis.global_.offwidth, self._model.vis.global_.offheight = width, height
        # Smooth edges would take three times as long where there is no graphics card: two cameras, more than a core.
        self._model.vis.quality.offsamples = 0
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)
        try:
            self._gl = make_context(gl, width, height)
        except (ImportError, AttributeError, OSError, RuntimeError) as error:
            raise CameraError(f"no pictures can be drawn by '{gl}': {error}") from error
        self._scene = mujoco.MjvScene(self._model, _MAX_GEOMS)
        self._option, self._camera = mujoco.MjvOption(), mujoco.MjvCamera()
        self._context = mujoco.MjrContext(self._model, mujoco.mjtFontScale.mjFONTSCALE_100.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        self._pixels = np.empty((height, width, 3), np.uint8)

    def set(self, looks: Float[np.ndarray, " n"]) -> None:
        """Put everything where `looks_of` saw it."""
        set_looks(self._model, self._data, looks)

    def draw(self, camera: str) -> UInt8[np.ndarray, "height width 3"]:
        """What a camera of the model sees, as red, green, blue. Shape (height, width, 3).

        Raises:
            CameraError: If the model has no such camera.
        """
        number = mujoco.mj_name2id(self._model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
        if number < 0:
            raise CameraError(f"the model has no camera '{camera}'.")
        self._camera.type, self._camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, number
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self._model, self._data, self._option, None, self._camera, everything, self._scene)
        mujoco.mjr_render(self._rectangle, self._scene, self._context)
        mujoco.mjr_readPixels(self._pixels, None, self._rectangle, self._context)
        return np.flipud(self._pixels).copy()  # OpenGL counts rows from below.

    def close(self) -> None:
        """Let go of the context."""
        self._context.free()
        self._gl.free()
