"""Simulator, and pictures without a screen."""

from importlib.util import find_spec

from wrenchflow.doctor.check import Check, seconds_said
from wrenchflow.doctor.machine import installed
from wrenchflow.doctor.probe import ask

_LIMIT_S = 60.0
_PERIOD_S = 1 / 30  # Of a camera.
# What Debian and Ubuntu call the libraries.
_PACKAGES = {"egl": ("EGL", "libegl1 libgl1-mesa-dri"), "osmesa": ("OSMesa", "libosmesa6")}


def has_simulator() -> bool:
    """Whether MuJoCo is installed; it is not loaded."""
    return find_spec("mujoco") is not None


def check_simulator() -> Check:
    """Whether tasks can be simulated."""
    if has_simulator():
        return Check(name="simulator", state="ok", found=f"mujoco {installed('mujoco')}")
    return Check(
        name="simulator",
        state="missing",
        found="mujoco is not installed",
        means="`collect`, `deploy`, `replay` and `quickstart` do not run; recording a robot and processing do.",
        todo="pip install 'wrenchflow[sim]'",
    )


def check_rendering(backend: str) -> Check:
    """Render pictures with one backend, in a process of its own: a broken driver ends the process that loads it.

    Args:
        backend: `egl` or `osmesa`.
    """
    label, packages = _PACKAGES[backend]
    name = f"rendering, {label}"
    other = next(label for key, (label, _) in _PACKAGES.items() if key != backend)
    if not has_simulator():
        return Check(name=name, state="missing", found="not tried: mujoco is not installed")
    answer = ask(["-m", "wrenchflow.sim.gl", backend], limit_s=_LIMIT_S, environment={"MUJOCO_GL": backend})
    if answer.failure:
        return Check(
            name=name,
            state="missing",
            found=f"does not work: {answer.failure}",
            means=f"No pictures by {label}; either of {label} and {other} is enough, and streams need neither.",
            todo=f"sudo apt install {packages}",
        )
    frame_s, renderer = answer.figures["frame_s"], answer.figures["renderer"]
    is_fast = frame_s < _PERIOD_S
    return Check(
        name=name,
        state="ok" if is_fast else "warning",
        found=f"{seconds_said(frame_s)} for a picture of 224 x 224, by {renderer}",
        means="" if is_fast else "A camera of 30 Hz is too much for it.",
        todo="" if is_fast else "Take fewer pictures a second, or a machine with a graphics card.",
        figures={"frame_s": frame_s, "renderer": renderer},
    )
