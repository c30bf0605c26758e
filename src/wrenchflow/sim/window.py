"""MuJoCo's passive viewer: a window on a scene that is simulated elsewhere."""

import mujoco
import mujoco.viewer
import numpy as np
from jaxtyping import Float

from wrenchflow.errors import OutputError
from wrenchflow.sim.state import model_of, set_looks


class Window:
    """Shows what it is told a scene looks like."""

    def __init__(self, model: bytes) -> None:
        """Open it.

        Args:
            model: As `sim.state.model_bytes` gives it.

        Raises:
            OutputError: If there is no window to be had.
        """
        self._model = model_of(model)
        self._data = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, self._data)
        try:
            self._viewer = mujoco.viewer.launch_passive(
                self._model, self._data, show_left_ui=False, show_right_ui=False
            )
        except (RuntimeError, ValueError, mujoco.FatalError) as error:
            raise OutputError(f"MuJoCo's viewer does not open: {error}") from error

    @property
    def is_open(self) -> bool:
        """Whether nobody has closed it."""
        return self._viewer.is_running()

    def show(self, looks: Float[np.ndarray, " n"]) -> None:
        """Show a moment, as `sim.state.looks_of` gives it."""
        with self._viewer.lock():
            set_looks(self._model, self._data, looks)
        self._viewer.sync()

    def close(self) -> None:
        """Close it."""
        self._viewer.close()
