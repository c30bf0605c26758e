"""`wrenchflow doctor` as a person runs it: on this machine, and on one with nothing but what recording needs."""

import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

import wrenchflow

SOURCES = Path(wrenchflow.__file__).parents[1]
# Of these nothing is there on a machine that only records.
HIDDEN = ("mujoco", "torch", "rerun", "lerobot", "pillow", "PIL", "OpenGL")


def run(*arguments: object, python: str = sys.executable, path: str = "") -> subprocess.CompletedProcess[str]:
    found = os.pathsep.join(filter(None, [str(SOURCES), path, "" if path else os.environ.get("PYTHONPATH", "")]))
    command = [python, "-m", "wrenchflow", "doctor", *map(str, arguments)]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, timeout=300, env={**os.environ, "PYTHONPATH": found}
    )


@pytest.fixture(scope="module")
def bare(tmp_path_factory) -> tuple[str, str]:
    """A Python beside whose packages simulator, learning and viewing are missing, and where its packages are."""
    folder = tmp_path_factory.mktemp("packages")
    for entry in Path(sysconfig.get_paths()["purelib"]).iterdir():
        if not entry.name.startswith(HIDDEN):
            (folder / entry.name).symlink_to(entry)
    return getattr(sys, "_base_executable", sys.executable), str(folder)


def test_this_machine_can_record(tmp_path):
    ran = run("--json", "--folder", tmp_path)
    assert (ran.returncode, ran.stderr) == (0, "")
    found = json.loads(ran.stdout)
    assert found["ready"] is True
    checks = {check["name"]: check for check in found["checks"]}
    assert {check["state"] for check in checks.values()} <= {"ok", "warning", "missing"}
    assert {"shared memory", "disk", "timer", "SCHED_FIFO", "SpaceMouse", "rendering, EGL", "GPU"} <= checks.keys()
    assert checks["simulator"]["state"] == "ok"
    # Whatever is not well says what follows from it.
    assert all(
        check["means"] or check["found"].startswith("not tried") for check in checks.values() if check["state"] != "ok"
    )
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_exit_code_1_without_what_is_optional(bare):
    python, path = bare
    ran = run("--folder", "/proc", python=python, path=path)
    assert (ran.returncode, ran.stderr) == (1, "")
    lines = {tuple(line.split()[:2]) for line in ran.stdout.splitlines() if line}
    assert {("missing", name) for name in ("disk", "simulator", "GPU", "torch", "rerun-sdk", "lerobot")} <= lines
    assert ("ok", "shared") in lines
    assert ran.stdout.splitlines()[-1].startswith("Not ready to record: disk.")


def test_a_machine_that_only_records_is_ready(bare, tmp_path):
    python, path = bare
    ran = run("--json", "--folder", tmp_path, python=python, path=path)
    assert (ran.returncode, ran.stderr) == (0, "")
    checks = {check["name"]: check for check in json.loads(ran.stdout)["checks"]}
    assert checks["torch"]["found"] == "not installed"
    assert checks["GPU"]["found"] == "not tried: torch is not installed"
    assert checks["rendering, EGL"]["found"] == "not tried: mujoco is not installed"


def test_neither_torch_nor_mujoco_is_loaded(tmp_path):
    program = (
        "import sys\nfrom wrenchflow.cli import main\n"
        f"code = main(['doctor', '--folder', {str(tmp_path)!r}])\n"
        "print(*sorted(sys.modules), file=sys.stderr)\nsys.exit(code)\n"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr[-2000:]
    assert not {"torch", "mujoco", "rerun", "lerobot", "OpenGL"} & set(ran.stderr.split())
