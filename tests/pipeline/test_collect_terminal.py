"""`collect` at a real terminal, a pseudo one: its keys, its board, and that it leaves the terminal as it found it."""

import json
import os
import pty
import re
import signal
import subprocess
import sys
import termios
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from wrenchflow.recording.reader import read_episode

pytestmark = pytest.mark.slow  # A minute: each waits for a session to begin and to end by the clock.

PATIENCE_S = 120.0
COMMAND = (sys.executable, "-m", "wrenchflow", "collect", "raw", "--tare-s", "0.4", "--seed", "3", "--no-sound")


@dataclass
class Terminal:
    """A command at a terminal: what it wrote there, and keys for it."""

    running: subprocess.Popen
    primary: int
    secondary: int
    before: list
    written: bytes = b""
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def read(self) -> None:
        while True:
            try:
                data = os.read(self.primary, 65536)
            except OSError:
                return
            with self._lock:
                self.written += data

    def waits_for(self, pattern: str, start: int = 0) -> int:
        """Wait until it has written this; returns where it ends."""
        stop_s = time.monotonic() + PATIENCE_S
        while not (found := re.search(pattern.encode(), self.written[start:])):
            assert self.running.poll() is None, self.written[-3000:].decode()
            assert time.monotonic() < stop_s, f"{pattern} did not come: {self.written[-3000:].decode()}"
            time.sleep(0.02)
        return start + found.end()

    def press(self, keys: bytes) -> None:
        os.write(self.primary, keys)

    def ends(self) -> int:
        """Wait for its end; the terminal is as it was, and its cursor can be seen."""
        code = self.running.wait(PATIENCE_S)
        assert termios.tcgetattr(self.secondary) == self.before
        time.sleep(0.1)
        hidden, shown = self.written.rfind(b"\x1b[?25l"), self.written.rfind(b"\x1b[?25h")
        assert shown > hidden >= 0
        return code


@pytest.fixture
def at_terminal(tmp_path):
    """Run `collect` at a terminal."""
    begun = []

    def run(*flags: str) -> Terminal:
        primary, secondary = pty.openpty()
        termios.tcsetwinsize(secondary, (40, 130))
        before = termios.tcgetattr(secondary)
        running = subprocess.Popen(
            [*COMMAND, *flags],
            cwd=tmp_path,
            stdin=secondary,
            stdout=subprocess.PIPE,
            stderr=secondary,
            env={**os.environ, "TERM": "xterm-256color", "OMP_NUM_THREADS": "1"},
            start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        )
        terminal = Terminal(running, primary, secondary, before)
        threading.Thread(target=terminal.read, daemon=True).start()
        begun.append(terminal)
        return terminal

    yield run
    for terminal in begun:
        if terminal.running.poll() is None:
            os.killpg(terminal.running.pid, signal.SIGKILL)
        terminal.running.wait()
        terminal.running.stdout.close()
        os.close(terminal.secondary)
        os.close(terminal.primary)


LEFT, RIGHT, ESCAPE = b"\x1b[D", b"\x1b[C", b"\x1b"


def test_keys_move_keep_discard_and_stop(tmp_path, at_terminal):
    terminal = at_terminal("--operator", "keyboard", "--episodes", "5", "--no-viewer", "--time-limit-s", "30", "--json")
    terminal.waits_for("keyboard: peg-insertion")
    at = terminal.waits_for("episode 1 of 5.*\n.*under way")
    terminal.press(b"aaaaa")  # A step to the left.
    time.sleep(0.3)
    terminal.press(b"m")
    time.sleep(0.3)
    terminal.press(LEFT)
    at = terminal.waits_for("discarded  peg-insertion", at)
    at = terminal.waits_for("under way", terminal.waits_for("tare: hands off", at))
    time.sleep(1.0)  # Arrows in the first instant are not heard.
    terminal.press(RIGHT)
    at = terminal.waits_for("1 of 5  peg-insertion", at)
    terminal.waits_for("under way", terminal.waits_for("tare: hands off", at))
    terminal.press(ESCAPE)
    terminal.waits_for("the last one", at)
    time.sleep(1.0)
    terminal.press(RIGHT)
    assert terminal.ends() == 0
    result = json.loads(terminal.running.communicate()[0])
    assert (result["episodes"], result["failures"]) == (2, {"operator: ended": 2})
    (discarded,) = (tmp_path / "raw" / "discarded").glob("*.mcap")
    episode = read_episode(discarded)
    assert episode.meta["result"]["failure"] == "operator: discarded"
    assert episode["teleop/twist"].data[:, 1].max() > 0.0  # It went to the left.
    assert len(episode.events_of("mark")) == 1
    assert len(list((tmp_path / "raw").glob("*.mcap"))) == 2


def test_ctrl_c_stops_the_arm_and_leaves_the_terminal_as_it_was(tmp_path, at_terminal):
    terminal = at_terminal("--operator", "keyboard", "--episodes", "5", "--no-viewer")
    terminal.waits_for("under way")
    os.killpg(terminal.running.pid, signal.SIGINT)  # As a terminal does, which here is nobody's controlling one.
    assert terminal.ends() == 130
    assert b"wrenchflow: interrupted. 0 of 5 episodes are in " in terminal.written
    assert b"Go on with: wrenchflow collect raw " in terminal.written
    (path,) = (tmp_path / "raw.partial" / "discarded").glob("*.mcap")
    assert read_episode(path).meta["result"]["failure"] == "stopped: emergency-stop"


def test_a_board_is_drawn_where_many_record_at_once(tmp_path, at_terminal):
    terminal = at_terminal("--operator", "emulated", "--episodes", "3", "--jobs", "2")
    terminal.waits_for("emulated: peg-insertion")
    terminal.waits_for("s simulated a second")
    assert terminal.ends() == 0
    assert len(list(Path(tmp_path / "raw").glob("*.mcap"))) == 3


def test_a_board_that_is_killed_takes_nothing_with_it(tmp_path, at_terminal):
    terminal = at_terminal("--operator", "keyboard", "--episodes", "1", "--no-viewer", "--time-limit-s", "4")
    terminal.waits_for("under way")
    # It is the child that draws: of all of them, the one whose name says so is not told by the system, so all are tried
    # by what they have open; here it is enough that it has a terminal for its stderr and is less urgent.
    for status in Path("/proc").glob("[0-9]*/stat"):
        fields = status.read_text().rsplit(")", 1)[1].split()
        if int(fields[1]) == terminal.running.pid and int(fields[16]) == 10:
            os.kill(int(status.parent.name), signal.SIGKILL)
            break
    else:
        raise AssertionError("no process draws")
    assert terminal.ends() == 0
    assert len(list((tmp_path / "raw").glob("*.mcap"))) == 1
