"""A simulation as bytes and numbers: its model and whole state, to run it again, or its looks, to draw it."""

import gzip
import zlib
from functools import lru_cache

import mujoco
import numpy as np
from jaxtyping import Float

from wrenchflow.errors import ControlError

# All that the next step depends on.
_WHOLE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
# Joints, and bodies that are put somewhere.
_LOOKS = int(mujoco.mjtState.mjSTATE_QPOS | mujoco.mjtState.mjSTATE_MOCAP_POS | mujoco.mjtState.mjSTATE_MOCAP_QUAT)


def model_bytes(model: mujoco.MjModel) -> bytes:
    """A model to the last bit, as MuJoCo's own compressed binary; another version of MuJoCo cannot read it."""
    content = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return _packed(content.tobytes())


@lru_cache(maxsize=4)
def _packed(content: bytes) -> bytes:
    # Every episode of a folder carries the same model, and packing it takes as long as a second of simulation.
    return gzip.compress(content, mtime=0)


def model_of(content: bytes) -> mujoco.MjModel:
    """The model of some bytes.

    Raises:
        ControlError: If they are none, or of another version of MuJoCo.
    """
    try:
        return mujoco.MjModel.from_binary_path("model", {"model": gzip.decompress(content)})
    except (OSError, EOFError, ValueError, zlib.error) as error:
        raise ControlError(f"no model of MuJoCo {mujoco.__version__}: {error}") from error


def state_of(model: mujoco.MjModel, data: mujoco.MjData) -> Float[np.ndarray, " n"]:
    """All that the next step depends on. Shape (n,)."""
    return _get(model, data, _WHOLE)


def set_state(model: mujoco.MjModel, data: mujoco.MjData, state: Float[np.ndarray, " n"]) -> None:
    """Go on from a state, with all that follows from it computed."""
    mujoco.mj_setState(model, data, state, _WHOLE)
    mujoco.mj_forward(model, data)


def state_size(model: mujoco.MjModel) -> int:
    """How many numbers `state_of` returns."""
    return mujoco.mj_stateSize(model, _WHOLE)


def looks_of(model: mujoco.MjModel, data: mujoco.MjData) -> Float[np.ndarray, " n"]:
    """What a scene looks like, to be drawn later or elsewhere. Shape (n,)."""
    return _get(model, data, _LOOKS)


class Looks:
    """What a scene looks like, again and again, for a loop that has no time: numbers, copied from where they lie."""

    def __init__(self, data: mujoco.MjData) -> None:
        """Find the numbers; they stay where they are as long as the simulation does."""
        self._parts = (data.qpos, data.mocap_pos.reshape(-1), data.mocap_quat.reshape(-1))

    def into(self, looks: Float[np.ndarray, " n"]) -> None:
        """Write what `looks_of` would return."""
        np.concatenate(self._parts, out=looks)


def looks_size(model: mujoco.MjModel) -> int:
    """How many numbers `looks_of` returns."""
    return mujoco.mj_stateSize(model, _LOOKS)


def set_looks(model: mujoco.MjModel, data: mujoco.MjData, looks: Float[np.ndarray, " n"]) -> None:
    """Put everything where `looks_of` saw it, as far as drawing needs."""
    mujoco.mj_setState(model, data, looks, _LOOKS)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)


def _get(model: mujoco.MjModel, data: mujoco.MjData, what: int) -> Float[np.ndarray, " n"]:
    values = np.empty(mujoco.mj_stateSize(model, what))
    mujoco.mj_getState(model, data, values, what)
    return values
