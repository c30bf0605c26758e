"""Keys of a terminal: a process at one end of a pseudo-terminal, a person and their terminal's program at the other."""

import os
import pty
import re
import select
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

import wrenchflow
from wrenchflow.collect.keys import Keys

# Says READY, then each key until `q` comes, then whether the terminal is as it was.
PROGRAM = """
import sys, termios, time
from wrenchflow.collect.keys import Keys

def say(*words):
    print(*words, file=sys.stderr, flush=True)

before = termios.tcgetattr(0)
try:
    with Keys(releases=True) as keys:
        say("READY", keys.is_there, keys.has_releases)
        asked = 0
        while True:
            {take}
            for key in found:
                say("KEY", *key)
            if any(key.name == "q" for key in found):
                {end}
            asked += 1
            time.sleep(0.002)
except (KeyboardInterrupt, ZeroDivisionError) as error:
    say("ENDED BY", type(error).__name__)
say("RESTORED", termios.tcgetattr(0) == before)
"""
BRACKET = b"\x1b["


def run(
    type_: Callable[[int], None], *, kitty: bool, take: str = "found = keys.take()", end: str = "break"
) -> list[str]:
    """What a process says whose terminal a person types at."""
    ours, its = pty.openpty()
    environment = {
        **os.environ,
        "PYTHONPATH": str(Path(wrenchflow.__file__).parents[1]),
        "TERM": "xterm-256color",
        "BLESSED_QUERY_TIMEOUT_SECONDS": "5",
    }
    environment.pop("NO_COLOR", None)
    program = PROGRAM.format(take=take, end=end)
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdin=its, stderr=its, stdout=subprocess.DEVNULL, env=environment
    )
    os.close(its)
    said, typed, until = b"", False, time.monotonic() + 60.0
    try:
        while time.monotonic() < until:
            if not select.select([ours], [], [], 0.1)[0]:
                continue
            try:
                news = os.read(ours, 4096)
            except OSError:  # The other end is closed.
                break
            said += news
            for question in news.split(b"\x1b")[1:]:
                if question == b"[?u" and kitty:
                    os.write(ours, b"\x1b[?0u")
                if question.startswith(b"[6n"):
                    os.write(ours, b"\x1b[1;1R")
            if b"READY" in said and not typed:
                typed = True
                type_(ours)
        process.wait(timeout=10.0)
    finally:
        process.kill()
        process.wait()
        os.close(ours)
    said = re.sub(rb"\x1b(P[^\x1b]*\x1b\\|\[[0-?]*[@-~])", b"", said)  # What the terminal would not show.
    return said.decode().split("\r\n")[:-1]


def keys(lines: list[str]) -> list[str]:
    return [line.removeprefix("KEY ") for line in lines if line.startswith("KEY")]


def test_a_plain_terminal_names_its_keys_and_is_put_back():
    def type_(terminal: int) -> None:
        os.write(terminal, b"wW" + BRACKET + b"D" + BRACKET + b"C \n\x7f1")
        time.sleep(0.3)
        os.write(terminal, b"\x1b")  # Escape, for nothing follows.
        time.sleep(0.3)
        os.write(terminal, BRACKET + b"200~" + b"\x17\x1bw")  # No keys here: a paste, Ctrl-W and Alt-W.
        time.sleep(0.1)
        os.write(terminal, b"q")

    lines = run(type_, kitty=False)
    names = ["w", "w", "left", "right", "space", "enter", "backspace", "1", "escape", "q"]
    assert lines[0].startswith("READY True False")
    assert keys(lines) == [f"{name} press" for name in names]
    assert lines[-1] == "RESTORED True"


def test_an_arrow_key_that_comes_in_parts_is_no_escape():
    def type_(terminal: int) -> None:
        for part in (b"\x1b", b"[A"):
            os.write(terminal, part)
            time.sleep(0.005)
        os.write(terminal, b"q")

    # Asked so that no time goes by between the parts, as seen by the clock that tells an escape.
    assert keys(run(type_, kitty=False)) == ["up press", "q press"]


def test_a_terminal_with_the_kitty_protocol_tells_of_releases():
    def type_(terminal: int) -> None:
        codes = "119u 119;1:2u 119;1:3u 1;1:1D 1;1:3D 32u 27u 13u 127u 119:87;2u 119;5u"
        for code in codes.encode().split():
            os.write(terminal, BRACKET + code)
        os.write(terminal, BRACKET + b"113u")

    lines = run(type_, kitty=True)
    assert lines[0].startswith("READY True True")
    assert keys(lines) == [
        *("w press", "w repeat", "w release", "left press", "left release"),
        *("space press", "escape press", "enter press", "backspace press", "w press", "q press"),
    ]
    assert lines[-1] == "RESTORED True"


def test_ctrl_c_stays_a_signal_where_all_keys_come_as_events():
    lines = run(lambda terminal: os.write(terminal, BRACKET + b"99;5u"), kitty=True)
    assert lines[-2:] == ["ENDED BY KeyboardInterrupt", "RESTORED True"]


def test_the_terminal_is_put_back_after_an_error():
    lines = run(lambda terminal: os.write(terminal, b"q"), kitty=False, end="1 / 0")
    assert lines[-2:] == ["ENDED BY ZeroDivisionError", "RESTORED True"]


def test_each_listener_takes_its_own_keys():
    take = 'found = [] if asked < 100 else keys.take(("w", "q")) + keys.take(("left",))'
    lines = run(lambda terminal: os.write(terminal, b"w" + BRACKET + b"Daq"), kitty=False, take=take)
    assert keys(lines) == ["w press", "q press", "left press"]


def test_without_a_terminal_there_are_no_keys():
    program = (
        "from wrenchflow.collect.keys import Keys\n"
        "with Keys(releases=True) as keys:\n"
        "    print(keys.is_there, keys.take(), keys.pressed(('w',)))\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(wrenchflow.__file__).parents[1])}
    ran = subprocess.run(
        [sys.executable, "-c", program], input="w", capture_output=True, text=True, env=environment, check=False
    )
    assert (ran.stdout, ran.stderr) == ("False [] []\n", "")


def test_nothing_is_read_before_and_after():
    keys = Keys()
    assert (keys.is_there, keys.take()) == (False, [])
    with pytest.raises(ZeroDivisionError), keys:
        _ = 1 / 0
    assert keys.pressed() == []
