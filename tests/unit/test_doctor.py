"""What a machine lacks is found, said and told from what is essential; each fault is planted and seen."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from wrenchflow.doctor import packages, realtime, rendering
from wrenchflow.doctor.check import Check, bytes_said, seconds_said
from wrenchflow.doctor.devices import check_gamepad, check_spacemouse, hid_devices
from wrenchflow.doctor.disk import check_disk
from wrenchflow.doctor.machine import check_governor
from wrenchflow.doctor.probe import ask
from wrenchflow.told import doctor_lines


@pytest.mark.parametrize(
    ("program", "failure"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "crashed (SIGSEGV)"),
        ("import time; time.sleep(60)", "no answer within 2 s"),
        ("raise ImportError('no libEGL')", "ImportError: no libEGL"),
        ("raise SystemExit(3)", "exit code 3"),
        ("print('hello')", "an answer that makes no sense: 'hello\\n'"),
        ("", "an answer that makes no sense: ''"),
    ],
)
def test_a_probe_that_fails_says_how(program, failure):
    answer = ask(["-c", program], limit_s=2.0)
    assert (answer.failure, answer.figures) == (failure, {})


def test_a_probe_that_hangs_takes_what_it_started_along(tmp_path):
    program = (
        "import subprocess, sys, time, pathlib\n"
        "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
        f"pathlib.Path({str(tmp_path / 'pid')!r}).write_text(str(child.pid))\n"
        "time.sleep(60)\n"
    )
    assert ask(["-c", program], limit_s=3.0).failure
    pid = int((tmp_path / "pid").read_text())
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except FileNotFoundError:
        return
    assert state == "Z"  # Dead; who adopted it has not looked yet.


def test_a_driver_that_crashes_is_a_driver_that_is_missing(tmp_path, monkeypatch):
    (tmp_path / "mujoco.py").write_text("import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")]))
    check = rendering.check_rendering("egl")
    assert (check.state, check.found, check.stops) == ("missing", "does not work: crashed (SIGSEGV)", False)
    assert "libegl1" in check.todo


def test_without_the_simulator_nothing_is_rendered(monkeypatch):
    monkeypatch.setattr(rendering, "find_spec", lambda name: None)
    checks = rendering.check_simulator(), rendering.check_rendering("osmesa")
    assert [check.state for check in checks] == ["missing", "missing"]
    assert all("not installed" in check.found for check in checks)


def test_a_folder_that_cannot_be_written_stops_everything(tmp_path):
    (tmp_path / "file").touch()
    for folder in (Path("/proc"), tmp_path / "nowhere", tmp_path / "file"):
        check = check_disk(folder)
        assert (check.state, check.stops) == ("missing", True)
        assert f"cannot write to '{folder}'" in check.found


def test_a_folder_that_was_looked_at_is_as_it_was(tmp_path):
    check = check_disk(tmp_path)
    assert check.state != "missing"
    assert list(tmp_path.iterdir()) == []
    assert check.figures["free_bytes"] == pytest.approx(
        check.figures["room_minutes"] * 60 * check.figures["recording_bytes_s"]
    )


def hid(folder: Path, number: int, uevent: str | None, *, is_readable: bool = True) -> None:
    """Plant a HID device: its file, and what the kernel says of it."""
    (folder / "dev").mkdir(exist_ok=True)
    device = folder / "dev" / f"hidraw{number}"
    device.touch()
    device.chmod(0o600 if is_readable else 0)
    if uevent is not None:
        described = folder / "class" / f"hidraw{number}" / "device"
        described.mkdir(parents=True)
        (described / "uevent").write_text(uevent)


def spacemouse(folder: Path) -> Check:
    return check_spacemouse(hid_devices(folder / "dev", folder / "class"))


KEYBOARD = "DRIVER=hid-generic\nHID_ID=0003:0000046D:0000C31C\nHID_NAME=Logitech USB Keyboard\n"
SPACEMOUSE = "DRIVER=hid-generic\nHID_ID=0003:0000256F:0000C635\nHID_NAME=3Dconnexion SpaceMouse Compact\n"
NAVIGATOR = "HID_ID=0003:0000046D:0000C626\nHID_NAME=3Dconnexion SpaceNavigator\n"


def test_no_devices_and_devices_of_others_are_told_apart(tmp_path):
    assert (spacemouse(tmp_path).state, spacemouse(tmp_path).found) == ("missing", "no HID devices")
    hid(tmp_path, 0, KEYBOARD)
    hid(tmp_path, 1, None)
    hid(tmp_path, 2, "HID_ID=nonsense\nno line\n")
    assert spacemouse(tmp_path).state == "missing"
    assert "no SpaceMouse among 3 HID devices" in spacemouse(tmp_path).found


@pytest.mark.parametrize("uevent", [SPACEMOUSE, NAVIGATOR])
def test_a_spacemouse_is_known_by_its_maker(tmp_path, uevent, monkeypatch):
    hid(tmp_path, 0, KEYBOARD)
    hid(tmp_path, 1, uevent)
    assert spacemouse(tmp_path).state == "ok"
    assert "3Dconnexion" in spacemouse(tmp_path).found
    # Root may read everything, so the answer is planted, and not the rights.
    monkeypatch.setattr("wrenchflow.doctor.devices.os.access", lambda path, mode: False)
    check = spacemouse(tmp_path)
    assert check.state == "warning"
    assert f'ATTRS{{idVendor}}=="{uevent.split(":")[1][4:].lower()}"' in check.todo


def test_a_gamepad_is_found_by_its_kernel_names(tmp_path, monkeypatch):
    inputs, classes = tmp_path / "input", tmp_path / "class"
    inputs.mkdir()
    assert check_gamepad(inputs, classes).state == "missing"
    (classes / "js0" / "device" / "event7").mkdir(parents=True)
    (classes / "js0" / "device" / "name").write_text("Some Pad\n")
    (classes / "event7").mkdir()
    assert check_gamepad(inputs, classes).state == "warning"
    (inputs / "event7").touch()
    check = check_gamepad(inputs, classes)
    assert (check.state, check.found) == ("ok", f"Some Pad at {inputs}/js0, readable")
    monkeypatch.setattr("wrenchflow.doctor.devices.os.access", lambda path, mode: False)
    assert "group `input`" in check_gamepad(inputs, classes).todo


def test_real_time_scheduling_is_tried_and_given_back(monkeypatch):
    policy = os.sched_getscheduler(0)
    realtime.check_scheduling()
    assert os.sched_getscheduler(0) == policy
    monkeypatch.setattr(realtime, "_TRY_FIFO", "raise PermissionError(1, 'Operation not permitted')")
    check = realtime.check_scheduling()
    assert (check.state, check.stops) == ("warning", False)
    assert "Operation not permitted" in check.found
    assert "rtprio" in check.todo


def test_sleeps_are_measured():
    figures = realtime.check_timer().figures
    assert 0 < figures["late_p50_s"] <= figures["late_p999_s"] <= figures["late_max_s"]


@pytest.mark.parametrize(
    ("governors", "state"), [((), "missing"), (("performance",) * 2, "ok"), (("performance", "powersave"), "warning")]
)
def test_governors(tmp_path, governors, state):
    for number, governor in enumerate(governors):
        (tmp_path / f"cpu{number}" / "cpufreq").mkdir(parents=True)
        (tmp_path / f"cpu{number}" / "cpufreq" / "scaling_governor").write_text(governor + "\n")
    assert check_governor(tmp_path).state == state


def test_packages_that_are_not_installed(monkeypatch):
    monkeypatch.setattr(packages, "installed", lambda package: None)
    for package in packages.OPTIONAL:
        check = packages.check_package(package)
        assert (check.state, check.found, check.stops) == ("missing", "not installed", False)
    assert packages.check_gpu().found == "not tried: torch is not installed"


SHARED = """
import json
from wrenchflow.config import to_mapping
from wrenchflow.doctor.shared_memory import check_shared_memory
print(json.dumps(to_mapping(check_shared_memory())))
"""


def shared_memory(*before: str) -> dict:
    ran = subprocess.run([*before, sys.executable, "-c", SHARED], capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stderr) == (0, "")
    return json.loads(ran.stdout)


def test_rows_go_to_another_process_and_back():
    check = shared_memory()
    assert check["state"] != "missing"
    assert check["figures"]["rows"] == 2000


def test_shared_memory_that_is_too_small_is_told():
    """In a mount namespace of its own, where shared memory has room for half a ring."""
    small = ("unshare", "--mount", "sh", "-c", 'mount -t tmpfs -o size=1m tmpfs /dev/shm && exec "$@"', "sh")
    try:
        subprocess.run([*small, "true"], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("this machine lets us mount nothing")
    check = shared_memory(*small)
    assert (check["state"], check["essential"]) == ("missing", True)
    assert "can be made in shared memory" in check["found"]
    assert "no space left on device" in check["found"]


def test_lines_are_aligned_and_end_with_the_verdict():
    some = Check(name="disk", state="missing", found="x " * 100, means="m", todo="t", essential=True)
    fine = Check(name="shared memory", state="ok", found="Y")
    lines = doctor_lines({"checks": [vars(some), vars(fine)]})
    assert max(map(len, lines)) <= 120
    assert {line.index(text) for line, text in ((lines[0], "x "), (lines[-3], "Y"))} == {24}
    assert lines[-1] == "Not ready to record: disk. 1 ok, 0 warnings, 1 missing."


def test_quantities_as_people_say_them():
    assert [bytes_said(n) for n in (0, 999, 2**20 - 4096, 3 * 2**30, 2**41)] == [
        "0 B",
        "999 B",
        "0.996 MiB",
        "3.0 GiB",
        "2,048.0 GiB",
    ]
    assert [seconds_said(s) for s in (2.5e-6, 0.0015, 2.0)] == ["2.5 us", "1.5 ms", "2 s"]
