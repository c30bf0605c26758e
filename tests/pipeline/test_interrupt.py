"""Ctrl-C in any stage: exit code 130, one line, nothing that looks whole, and nobody left running."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(os.name == "nt", reason="process groups")

COMMAND = str(Path(sys.executable).with_name("wrenchflow"))
PATIENCE_S = 120.0


def wait_until(condition: Callable[[], bool], running: subprocess.Popen[str], what: str) -> None:
    stop_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert running.poll() is None, f"it ended before {what}: {running.communicate()}"
        assert time.monotonic() < stop_s, f"{what} did not come."
        time.sleep(0.01)


def group_is_alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def interrupted(
    at: Path, arguments: list[object], ready: Callable[[], bool], *, whole_group: bool, done: tuple[str, ...] = ()
) -> None:
    """Start a command, press Ctrl-C once `ready`, and look at what is left besides what was `done` before."""
    before = {path for path in at.rglob("*") if path.is_file()}
    command = [COMMAND, *map(str, arguments)]
    # A session of its own makes it the leader of a process group, as a shell makes a command.
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=at,
        start_new_session=True,
        env=environment,
    ) as running:
        try:
            wait_until(ready, running, "the moment to interrupt it")
            # A terminal tells the whole group; whoever knows only the number of the process tells it alone.
            (os.killpg if whole_group else os.kill)(running.pid, signal.SIGINT)
            stdout, stderr = running.communicate(timeout=PATIENCE_S)
        finally:
            if group_is_alive(running.pid) and running.poll() is None:
                os.killpg(running.pid, signal.SIGKILL)
    assert (running.returncode, stdout) == (130, "")
    assert re.fullmatch(
        r"(\d+ of \d+  .*\n)*"  # Episodes that were there.
        r"wrenchflow: interrupted\.( The black box(es of \d+ attempts are in| is) '[^']+'\.)?"
        rf"( Go on with: wrenchflow {re.escape(' '.join(command[1:]))} --resume)?\n",
        stderr,
    )
    left = {path for path in at.rglob("*") if path.is_file()} - before
    names = [str(path.relative_to(at)) for path in left if not path.name.endswith(".blackbox.mcap")]
    assert [name for name in names if ".partial" not in name and not name.startswith(done)] == []
    assert ("black box" in stderr) == (len(names) < len(left))
    stop_s = time.monotonic() + PATIENCE_S
    while group_is_alive(running.pid):
        assert time.monotonic() < stop_s, "somebody of its process group is still there."
        time.sleep(0.01)


def has_workers(at: Path) -> bool:
    """Whether a command in a folder has started another process for its work."""
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):  # It has ended meanwhile, or is somebody else's.
            if b"spawn_main" in (process / "cmdline").read_bytes() and (process / "cwd").readlink() == at:
                return True
    return False


LESS = [(1, True), (2, False)]  # Both are told apart by the other two already.


def some(at: Path, pattern: str) -> Callable[[], bool]:
    return lambda: any(at.glob(pattern))


@pytest.mark.parametrize(
    ("jobs", "whole_group"), [(1, False), (2, True), *(pytest.param(*each, marks=pytest.mark.slow) for each in LESS)]
)
def test_in_collect(tmp_path, jobs, whole_group):
    collect = ["collect", "raw", "--episodes", 500, "--jobs", jobs]
    interrupted(tmp_path, collect, some(tmp_path, "raw.partial/*.mcap"), whole_group=whole_group)


def test_in_collect_before_the_workers_have_started(tmp_path):
    collect = ["collect", "raw", "--episodes", 500, "--jobs", 2]
    interrupted(tmp_path, collect, some(tmp_path, "raw.partial"), whole_group=True)


@pytest.fixture
def many(chain, tmp_path) -> Path:
    """A folder of more recordings than can be worked off before Ctrl-C."""
    for stage in ("raw", "clean"):
        (tmp_path / stage).mkdir()
        for path in (chain.folder / stage).glob("*.mcap"):
            for copy in range(40):
                (tmp_path / stage / f"{path.stem}-{copy}.mcap").symlink_to(path)
    return tmp_path


@pytest.mark.slow
def test_in_process(many):
    process = ["process", "raw", "out", "--jobs", 2]
    interrupted(many, process, some(many, "out.partial/*.mcap"), whole_group=True)


@pytest.mark.slow
def test_in_train(chain, tmp_path):
    train = ["train", chain.folder / "dataset", "out", "--steps", 1_000_000, "--metrics-every", 5, "--threads", 1]
    metrics = tmp_path / "out.partial" / "metrics.jsonl"
    interrupted(tmp_path, train, lambda: metrics.exists() and metrics.stat().st_size > 0, whole_group=True)


@pytest.mark.slow
def test_in_deploy(chain, tmp_path):
    deploy = ["deploy", chain.folder / "run", "out", "--episodes", 400, "--jobs", 2]
    # Its workers are loading torch then; in `collect` they are at work.
    interrupted(tmp_path, deploy, some(tmp_path, "out.partial"), whole_group=True)


@pytest.mark.slow
def test_in_quickstart_while_its_policies_train(tmp_path):
    quickstart = ["quickstart", "out", "--episodes", 2, "--train-steps", 1_000_000, "--jobs", 2]
    ready = some(tmp_path, "out/run*.partial/metrics.jsonl")
    done = ("out/raw/", "out/clean/", "out/dataset/")
    interrupted(tmp_path, quickstart, ready, whole_group=True, done=done)


def test_a_data_set_is_there_when_it_is_whole_and_not_before(many):
    # Reading takes most of the time, and leaves nothing at all; so it is interrupted when somebody begins to.
    export = ["export", "robomimic", "clean", "out", "--jobs", 2]
    interrupted(many, export, lambda: has_workers(many), whole_group=True)
    assert not (many / "out" / "robomimic.hdf5").exists()


def test_ctrl_c_while_the_command_line_loads():
    program = (
        "import sys\n"
        "class Hand:\n"
        "    def find_spec(self, name, path=None, target=None):\n"
        "        if name == 'tyro': raise KeyboardInterrupt\n"
        "sys.meta_path.insert(0, Hand())\n"
        "from wrenchflow.__main__ import main\n"
        "sys.exit(main())"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout, ran.stderr) == (130, "", "wrenchflow: interrupted.\n")


def test_ctrl_c_that_falls_into_a_callback_is_heard():
    program = (
        "import os, signal, sys, time, weakref\n"
        "import wrenchflow.cli\n"
        "class Thing: pass\n"
        "def fall(_): os.kill(os.getpid(), signal.SIGINT)\n"
        "def work(*_):\n"
        "    thing = Thing(); reference = weakref.ref(thing, fall)\n"
        "    del thing\n"
        "    time.sleep(60)\n"
        "wrenchflow.cli.main = work\n"
        "from wrenchflow.__main__ import main\n"
        "sys.exit(main())"
    )
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=50)
    assert (ran.returncode, ran.stdout, ran.stderr) == (130, "", "wrenchflow: interrupted.\n")


def test_a_reader_that_has_gone_gets_no_traceback():
    reading, writing = os.pipe()
    os.close(reading)
    ran = subprocess.run([COMMAND, "--help"], stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert (ran.returncode, ran.stderr) == (141, "")
