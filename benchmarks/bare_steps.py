"""A scene that bare `mj_step` runs again: a model as XML, and what its actuators were told at each step.

It needs numpy and MuJoCo alone, so that an environment with another version of MuJoCo can run the same scene. Every
200 steps it starts again from what was recorded: two versions would soon be in different contacts otherwise.
"""

import time
from pathlib import Path

import mujoco
import numpy as np

_SEGMENT = 200
_STATE = ("qpos", "qvel", "qacc_warmstart", "mocap_pos", "mocap_quat")


def now_s() -> np.ndarray:
    """Wall time and processor time of this process [s]. Shape (2,)."""
    return np.array([time.perf_counter(), time.process_time()])


class SceneLog:
    """What is remembered of a simulation while it runs, to be run again."""

    def __init__(self) -> None:
        """Begin without steps."""
        self._ctrl: list[np.ndarray] = []
        self._contacts: list[int] = []
        self._starts: dict[str, list[np.ndarray]] = {name: [] for name in _STATE}

    def note(self, data: mujoco.MjData) -> None:
        """Take note of a step that is about to be made."""
        if len(self._ctrl) % _SEGMENT == 0:
            for name, values in self._starts.items():
                values.append(getattr(data, name).copy())
        self._ctrl.append(data.ctrl.copy())
        self._contacts.append(data.ncon)

    def save(self, path: Path, xml: str) -> None:
        """Write `<path>.xml` and `<path>.npz`.

        Args:
            path: Without a suffix.
            xml: Of the model; its assets have absolute paths.
        """
        path.with_suffix(".xml").write_text(xml)
        np.savez(path.with_suffix(".npz"), ctrl=self._ctrl, contacts=np.mean(self._contacts), **self._starts)


class BareScene:
    """A saved scene in the MuJoCo of this process."""

    def __init__(self, path: Path) -> None:
        """Load it."""
        self._model = mujoco.MjModel.from_xml_path(str(path.with_suffix(".xml")))
        self._data = mujoco.MjData(self._model)
        with np.load(path.with_suffix(".npz")) as saved:
            self._starts = {name: saved[name] for name in _STATE}
            ctrl, self.recorded_contacts = saved["ctrl"], float(saved["contacts"])
        self._steps = len(ctrl)
        self._segments = [ctrl[first : first + _SEGMENT] for first in range(0, len(ctrl), _SEGMENT)]

    def _begin(self, segment: int) -> None:
        for name, values in self._starts.items():
            getattr(self._data, name)[:] = values[segment]

    def contacts(self) -> float:
        """Contacts of a step, the mean of a run that nobody times."""
        count = 0
        for segment, told in enumerate(self._segments):
            self._begin(segment)
            for ctrl in told:
                self._data.ctrl[:] = ctrl
                mujoco.mj_step(self._model, self._data)
                count += self._data.ncon
        return count / self._steps

    def steps_per_s(self) -> list[float]:
        """Steps in a second of a run from start to end, by wall and process time."""
        model, data, step = self._model, self._data, mujoco.mj_step
        start_s = now_s()
        for segment, told in enumerate(self._segments):
            self._begin(segment)
            for ctrl in told:
                data.ctrl[:] = ctrl
                step(model, data)
        return (self._steps / (now_s() - start_s)).tolist()
