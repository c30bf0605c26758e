"""Who may import whom, read from the sources themselves; the checker is seen to find what is planted."""

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import wrenchflow

PACKAGE = Path(wrenchflow.__file__).parent

# A room: the rooms that it may import from, besides itself. `base` is every single file but the command line's.
MAY_IMPORT = {
    "base": set(),
    "recording": {"base"},
    "control": {"base"},
    "view": {"base", "recording"},
    "process": {"base", "recording", "pages"},
    "policy": {"base"},
    "pages": {"base"},
    "sim": {"base", "control"},
    "collect": {"base", "recording", "control", "sim", "process", "view"},
    "datasets": {"base", "recording", "process", "pages"},
    "train": {"base", "policy", "datasets"},
    "deploy": {"base", "recording", "control", "sim", "policy", "process"},
    "doctor": {"base", "recording"},
    "imports": {"base", "recording"},
}
MAY_IMPORT["cli"] = set(MAY_IMPORT)
COMMAND_LINE = {
    "cli",
    "command",
    "commands",
    "dataset_commands",
    "curation_commands",
    "told",
    "__main__",
    "describe",
    "quickstart",
    "quickstart_config",
    "present",
}
# A package that is heavy, or not everywhere: the rooms that may import it.
ONLY_IN = {
    "mujoco": {"sim"},
    "torch": {"policy", "train", "deploy"},
    "diffusers": {"policy", "train", "deploy"},
    "safetensors": {"policy", "train", "deploy"},
    "rich": {"collect"},
    "rerun": {"view"},
    "rerun_cli": {"view"},
    "lerobot": {"collect"},
    "blessed": {"collect"},
    "pygame": {"collect"},
    "hid": {"collect"},
    "hidraw": {"collect"},
    "rosbags": {"imports"},
    "zarr": {"datasets"},
    "numcodecs": {"datasets"},
}


def sources() -> dict[str, str]:
    """Source by module name, `wrenchflow.sim.engine` for one."""
    found = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path.read_text()
    return found


def room_of(module: str) -> str:
    parts = module.split(".")
    if len(parts) > 1 and parts[1] in MAY_IMPORT:
        return parts[1]
    return "cli" if len(parts) > 1 and parts[1] in COMMAND_LINE else "base"


def imported(module: str, source: str, modules: set[str]) -> Iterator[str]:
    """Full names of all that a module imports, wherever in it, relative imports included."""
    package = module if any(name.startswith(module + ".") for name in modules) else module.rpartition(".")[0]
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            origin = node.module or ""
            if node.level:
                above = package.split(".")[: len(package.split(".")) - node.level + 1]
                origin = ".".join([*above, *filter(None, [origin])])
            for alias in node.names:
                whole = f"{origin}.{alias.name}"
                is_module = whole in modules or (origin == "wrenchflow" and alias.name in MAY_IMPORT)
                yield whole if is_module else origin


def violations(sources: dict[str, str]) -> list[str]:
    found = []
    for module, source in sources.items():
        room = room_of(module)
        for name in imported(module, source, set(sources)):
            top = name.split(".")[0]
            allowed = MAY_IMPORT[room] | {room}
            if (top == "wrenchflow" and room_of(name) not in allowed) or (top in ONLY_IN and room not in ONLY_IN[top]):
                found.append(f"{module} ({room}) imports {name}")
    return found


def test_imports_point_down():
    assert violations(sources()) == []


def test_every_room_is_in_the_table():
    rooms = {path.parent.name for path in PACKAGE.glob("*/__init__.py")}
    assert rooms <= set(MAY_IMPORT)
    assert {"control", "sim", "recording", "policy"} <= rooms


@pytest.mark.parametrize(
    ("module", "source", "name"),
    [
        ("wrenchflow.control.new", "import mujoco", "mujoco"),
        ("wrenchflow.control.new", "def f():\n    import torch.nn as nn", "torch.nn"),
        ("wrenchflow.control.new", "from wrenchflow.sim.plant import Plant", "wrenchflow.sim.plant"),
        ("wrenchflow.control.new", "from wrenchflow import sim", "wrenchflow.sim"),
        ("wrenchflow.control.new", "from ..sim import plant", "wrenchflow.sim.plant"),
        ("wrenchflow.control.new", "from .. import sim", "wrenchflow.sim"),
        ("wrenchflow.spatial", "from .sim.plant import Plant", "wrenchflow.sim.plant"),
        ("wrenchflow.spatial", "import wrenchflow.control.robot", "wrenchflow.control.robot"),
        ("wrenchflow.train.new", "from wrenchflow.deploy import not_there", "wrenchflow.deploy"),
        ("wrenchflow.deploy.new", "if True:\n    from wrenchflow import cli", "wrenchflow.cli"),
        ("wrenchflow.deploy.new", "from wrenchflow.quickstart import nothing", "wrenchflow.quickstart"),
        ("wrenchflow.sim.new", "from wrenchflow.process.live import LiveWrench", "wrenchflow.process.live"),
        ("wrenchflow.datasets.new", "import safetensors.numpy", "safetensors.numpy"),
        ("wrenchflow.collect.new", "import rerun.blueprint as rrb", "rerun.blueprint"),
        ("wrenchflow.view.new", "from wrenchflow.collect.session import Session", "wrenchflow.collect.session"),
        ("wrenchflow.doctor.new", "def f():\n    import hidraw", "hidraw"),
        ("wrenchflow.imports.new", "from wrenchflow.process.filters import x", "wrenchflow.process.filters"),
        ("wrenchflow.process.new", "import rosbags.typesys", "rosbags.typesys"),
        ("wrenchflow.sim", "from ..recording import writer", "wrenchflow.recording.writer"),
    ],
)
def test_a_planted_violation_is_found(module, source, name):
    found = violations({**sources(), module: source})
    assert [line for line in found if line.startswith(f"{module} ")] == [f"{module} ({room_of(module)}) imports {name}"]


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("wrenchflow.control.new", "import numpy\nfrom . import law\nfrom ..spatial import compose"),
        ("wrenchflow.deploy.new", "import torch\nfrom wrenchflow.process.live import LiveWrench"),
        ("wrenchflow.cli", "def f():\n    from wrenchflow.deploy import rollout"),
        ("wrenchflow.__main__", "from wrenchflow.cli import main"),
    ],
)
def test_what_is_allowed_is_not_found(module, source):
    found = violations({**sources(), module: source})
    assert [line for line in found if line.startswith(f"{module} ")] == []


def named_like_the_standard_library(modules: dict[str, str]) -> list[str]:
    return [name for name in modules if name.split(".")[-1] in sys.stdlib_module_names - {"__main__"}]


def test_no_module_is_named_after_one_of_the_standard_library():
    assert named_like_the_standard_library(sources()) == []
    assert named_like_the_standard_library({"wrenchflow.control.types": ""}) == ["wrenchflow.control.types"]


def test_help_loads_nothing_heavy():
    program = (
        "import sys; sys.argv = ['wrenchflow', '--help']\n"
        "from wrenchflow.cli import main\n"
        "try:\n    main()\n"
        "except SystemExit as stop:\n    assert not stop.code, stop.code\n"
        "print(*sorted(sys.modules), file=sys.stderr)\n"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr[-2000:]
    assert "collect" in ran.stdout
    assert not {"torch", "mujoco", "rerun", "lerobot", "blessed", "pygame", "hidraw"} & set(ran.stderr.split())
