"""Packages that some stages need, and a GPU."""

from wrenchflow.doctor.check import Check
from wrenchflow.doctor.machine import installed
from wrenchflow.doctor.probe import ask

# Package: what does not work without it, and how it is installed.
OPTIONAL = {
    "torch": ("`train` and `deploy` do not run; a machine beside a robot that only records does without.", "learn"),
    "rerun-sdk": ("Recordings cannot be sent to Rerun; other viewers open the files.", "view"),
    "pillow": ("Camera pictures cannot be compressed.", "sim"),
    "hidapi": ("Nobody can steer an arm by a SpaceMouse.", "teleop"),
    "pygame": ("Nobody can steer an arm by a gamepad.", "teleop"),
    "blessed": ("Nobody can steer an arm by the keyboard, or keep and redo episodes by its keys.", "teleop"),
    "lerobot": ("Exports for LeRobot are written and read all the same; LeRobot's own training is not here.", ""),
}
_LIMIT_S = 120.0
# A multiplication shows that the driver works, where a look at what is there does not.
_TRY_GPU = """
import json, torch
if not torch.cuda.is_available():
    print(json.dumps({"device": None}))
else:
    ones = torch.ones(64, 64, device="cuda")
    assert float((ones @ ones).sum()) == 64.0**3
    print(json.dumps({"device": torch.cuda.get_device_name(0)}))
"""


def check_package(package: str) -> Check:
    """Whether a package of `OPTIONAL` is installed."""
    means, extra = OPTIONAL[package]
    found = installed(package)
    if found is not None:
        return Check(name=package, state="ok", found=found, figures={"version": found})
    return Check(
        name=package,
        state="missing",
        found="not installed",
        means=means,
        todo=f"pip install 'wrenchflow[{extra}]'" if extra else f"pip install {package}",
    )


def check_gpu() -> Check:
    """Whether torch can compute on a graphics card; in a process of its own, for loading it takes long."""
    if installed("torch") is None:
        return Check(name="GPU", state="missing", found="not tried: torch is not installed")
    answer = ask(["-c", _TRY_GPU], limit_s=_LIMIT_S)
    if answer.failure:
        return Check(
            name="GPU",
            state="missing",
            found=f"torch does not work: {answer.failure}",
            means="`train` and `deploy` will not run.",
            todo="Install torch again, in the build that fits this machine's driver.",
        )
    device = answer.figures["device"]
    return Check(
        name="GPU",
        state="ok" if device else "missing",
        found=device or "none that torch can use",
        means="" if device else "Not needed: the policies here are trained on processor cores in minutes.",
        figures={"device": device},
    )
