"""LeRobot's teleoperators as devices: each kind as a subclass of its real base class, and its own by their names."""

import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from lerobot.motors import Motor, MotorNormMode
from lerobot.utils.rotation import Rotation

import wrenchflow
from hands.teleoperator import DELTAS, Fed, deltas
from wrenchflow.collect.devices import lerobot_teleoperator
from wrenchflow.collect.devices.alignment import AlignmentLimits
from wrenchflow.collect.devices.lerobot_actions import HeldConfig, LeaderConfig
from wrenchflow.collect.devices.lerobot_teleoperator import LeRobotTeleoperator, SeesFollower, connect
from wrenchflow.errors import ConfigError, DeviceError
from wrenchflow.kinematics import panda_tcp
from wrenchflow.spatial import IDENTITY_POSE, compose, exp_so3, log_so3, make_pose, rotation_of

MS = 1_000_000
READY = np.array([0.0, -0.8, 0.0, -2.3, 0.0, 1.5, 0.8])
TOOL = np.array([0.0, 0.0, 0.2, 1.0, 0.0, 0.0, 0.0])
PANDA = panda_tcp(TOOL)
PHONE = {"phone.pos": np.ndarray, "phone.rot": Rotation, "phone.raw_inputs": dict, "phone.enabled": bool}
JOINTS = {**{f"joint_{i + 1}.pos": float for i in range(7)}, "gripper.pos": float}

Make = Callable[..., tuple[Fed, LeRobotTeleoperator]]


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Make]:
    made: list[tuple[Fed, LeRobotTeleoperator]] = []

    def make(
        features: dict[str, Any], use_degrees: bool | None = None, **options: Any
    ) -> tuple[Fed, LeRobotTeleoperator]:
        fed = Fed(tmp_path, features, use_degrees=use_degrees)
        made.append((fed, LeRobotTeleoperator(fed, **options)))
        return made[-1]

    yield make
    for fed, device in made:
        fed.end()
        device.close()


def phone(p: Any, R: np.ndarray, *, enabled: bool = True, **inputs: Any) -> dict[str, Any]:
    rot = Rotation.from_matrix(R)
    return {"phone.pos": np.array(p, float), "phone.rot": rot, "phone.raw_inputs": inputs, "phone.enabled": enabled}


def joints(q_rad: np.ndarray) -> dict[str, float]:
    return {**{f"joint_{i + 1}.pos": float(np.degrees(q)) for i, q in enumerate(q_rad)}, "gripper.pos": 50.0}


class TestIncrements:
    def test_they_are_shares_of_full_speed(self, make: Make):
        fed, device = make(DELTAS)
        assert (device.name, device.full_scale_counts) == ("lerobot-fed", 1000)
        for said, counts in (((1.0, -0.25, 0.5), [1000, -250, 500]), ((3.0, -3.0, 0.0), [1000, -1000, 0])):
            fed.feed(deltas(*said))
            assert device.read(5).counts.tolist() == [*counts, 0, 0, 0]

    def test_the_gripper_stays_as_it_was_told_last(self, make: Make):
        fed, device = make(DELTAS)
        found = []
        for gripper in (1, 0, 1, 2, 1):
            fed.feed(deltas(gripper=gripper))
            found.append(device.read(5).buttons)
        assert found == [0, 1, 1, 0, 0]

    def test_another_full_scale_is_told(self, make: Make):
        fed, device = make({"delta_x": float, "delta_y": float, "delta_z": float}, full_scale=0.02)
        fed.feed({"delta_x": 0.01, "delta_y": 0.0, "delta_z": -0.02})
        assert device.read(5).counts.tolist() == [500, 0, -1000, 0, 0, 0]

    @pytest.mark.parametrize(
        ("said", "problem"),
        [
            ({}, "its action lacks delta_x; it has nothing"),
            ({"delta_x": 0.0, "delta_z": 0.0}, "its action lacks delta_y; it has delta_x, delta_z"),
            (deltas(float("nan")), "delta_x is nan"),
            (deltas(0.0, float("inf")), "delta_y is inf"),
            (deltas(gripper=7), "gripper is 7, expected 0, 1 or 2"),
            ({**deltas(), "delta_x": "far"}, "could not convert string to float: 'far'"),
            ({**deltas(), "delta_x": None}, "float() argument must be a string or a real number, not 'NoneType'"),
            (RuntimeError("Incorrect status packet!"), "its driver fails: Incorrect status packet!"),
        ],
    )
    def test_what_makes_no_sense_is_a_problem_until_something_does(self, make: Make, said, problem):
        fed, device = make(DELTAS)
        fed.feed(deltas(0.5))
        device.read(5)
        fed.feed(said)
        reading = device.read(6)
        assert (reading.problem, reading.counts.any(), reading.t_ns) == (problem, False, 5)
        fed.feed(deltas(0.5))
        reading = device.read(7)
        assert (reading.problem, reading.counts[0], reading.t_ns) == ("", 500, 7)

    def test_a_driver_that_only_fails_has_gone(self, make: Make):
        fed, device = make(DELTAS)
        for i in range(19):
            fed.feed(TimeoutError("no answer"))
            assert device.read(i).problem
        fed.feed(TimeoutError("no answer"))
        with pytest.raises(DeviceError, match=r"'fed' has gone \(no answer\): look at its cable"):
            device.read(20)


class TestHeldPose:
    TARGET = make_pose(np.array([0.5, 0.1, 0.3]), exp_so3(np.array([np.pi, 0.0, 0.0])))

    def test_the_tool_moves_as_the_phone_while_it_is_enabled(self, make: Make):
        fed, device = make(PHONE)
        assert isinstance(device, SeesFollower)
        device.see_follower(READY, self.TARGET)
        R = exp_so3(np.array([0.1, -0.2, 0.3]))
        fed.feed(phone([9.0, 9.0, 9.0], R, enabled=False))
        assert device.read(1 * MS).pose is None
        fed.feed(phone([0.3, 0.2, 0.1], R))
        pose = device.read(2 * MS).pose
        assert pose is not None
        np.testing.assert_allclose(pose, self.TARGET, atol=1e-12)
        # LeRobot's axes of a phone: its -y is forward for the arm, its x is left, its z is up.
        turn = exp_so3(np.array([0.0, 0.0, 0.2]))
        fed.feed(phone([0.3, 0.2 - 0.05, 0.1 + 0.02], turn @ R))
        pose = device.read(3 * MS).pose
        assert pose is not None
        np.testing.assert_allclose(pose[:3], self.TARGET[:3] + [0.05, 0.0, 0.02], atol=1e-12)
        turned = rotation_of(pose[3:]) @ rotation_of(self.TARGET[3:]).T
        np.testing.assert_allclose(log_so3(turned), [0.0, 0.0, 0.2], atol=1e-9)

    def test_turns_go_through_the_same_axes_as_ways(self, make: Make):
        config = HeldConfig(forward=(0.0, 1.0, 0.0), up=(0.0, 0.0, 1.0), scale=2.0)
        fed, device = make(PHONE, held=config)
        device.see_follower(READY, IDENTITY_POSE)
        fed.feed(phone([0, 0, 0], np.eye(3)))
        device.read(1 * MS)
        fed.feed(phone([0.1, 0.0, 0.0], exp_so3(np.array([0.1, 0.0, 0.0]))))
        pose = device.read(2 * MS).pose
        assert pose is not None
        # Forward along the device's y and up along its z put its x to the right.
        np.testing.assert_allclose(pose[:3], [0.0, -0.2, 0.0], atol=1e-12)
        np.testing.assert_allclose(log_so3(rotation_of(pose[3:])), [0.0, -0.1, 0.0], atol=1e-9)

    def test_it_is_lifted_like_a_mouse(self, make: Make):
        fed, device = make(PHONE)
        device.see_follower(READY, self.TARGET)
        for i, (y, enabled) in enumerate([(0.0, True), (-0.1, True), (-0.1, False), (0.3, False)]):
            fed.feed(phone([0, y, 0], np.eye(3), enabled=enabled))
            device.read(i * MS)
        here = make_pose(self.TARGET[:3] + [0.1, 0, 0], rotation_of(self.TARGET[3:]))
        device.see_follower(READY, here)
        fed.feed(phone([0, 0.3, 0], np.eye(3)))
        pose = device.read(5 * MS).pose
        assert pose is not None
        np.testing.assert_allclose(pose, here, atol=1e-12)

    def test_after_a_failure_or_a_silence_it_begins_from_where_the_arm_is(self, make: Make):
        fed, device = make(PHONE)
        device.see_follower(READY, self.TARGET)
        at = MS
        for gap in ("failure", "silence"):
            fed.feed(phone([0, 0, 0], np.eye(3)))
            device.read(at)
            if gap == "failure":
                fed.feed({})
                assert device.read(at + MS).problem
            at += MS if gap == "failure" else 600 * MS
            fed.feed(phone([0, 0.4, 0], np.eye(3)))
            pose = device.read(at + 2 * MS).pose
            assert pose is not None
            np.testing.assert_allclose(pose, self.TARGET, atol=1e-12)
            fed.feed(phone([0, 0, 0], np.eye(3), enabled=False))
            device.read(at + 3 * MS)
            at += 4 * MS

    def test_a_pose_that_stands_still_to_the_bit_is_no_news(self, make: Make):
        fed, device = make(PHONE)
        device.see_follower(READY, self.TARGET)
        stamps = []
        for i, y in enumerate([0.0, 0.01, 0.01, 0.01, 0.02]):
            fed.feed(phone([0, y, 0], np.eye(3)))
            stamps.append(device.read((i + 1) * MS).t_ns // MS)
        assert stamps == [1, 2, 2, 2, 5]

    def test_nothing_moves_before_it_is_known_where_the_arm_is(self, make: Make):
        fed, device = make(PHONE)
        fed.feed(phone([0, 0, 0], np.eye(3)))
        reading = device.read(MS)
        assert (reading.problem, reading.pose) == ("it is not known where the arm is", None)

    def test_a_pose_that_is_none_is_a_problem(self, make: Make):
        fed, device = make(PHONE)
        device.see_follower(READY, self.TARGET)
        for p in ([float("nan"), 0, 0], [0, 0]):
            fed.feed(phone(p, np.eye(3)))
            reading = device.read(MS)
            assert (reading.problem, reading.pose) == ("its pose is not three finite numbers and a rotation", None)
        fed.feed({**phone([0, 0, 0], np.eye(3)), "phone.rot": None})
        assert device.read(MS).problem

    def test_its_buttons_hold_gripper_and_mark(self, make: Make):
        fed, device = make(PHONE)
        device.see_follower(READY, self.TARGET)
        fed.feed(phone([0, 0, 0], np.eye(3), reservedButtonA=True, reservedButtonB=False))
        assert device.read(MS).buttons == 1
        fed.feed(phone([0, 0, 0], np.eye(3), enabled=False, b1=0, b2=0, b3=1))
        assert device.read(MS).buttons == 2

    def test_axes_that_are_none_are_refused(self):
        with pytest.raises(ConfigError, match="unit vectors at right angles"):
            HeldConfig(forward=(0.0, 1.0, 0.0), up=(0.0, 1.0, 0.0))


class TestLeader:
    def test_it_moves_the_tool_once_both_arms_stand_alike(self, make: Make):
        fed, device = make(JOINTS, leader=LeaderConfig(kinematics=PANDA, units="degrees"))
        device.see_follower(READY, PANDA(READY))
        leader = READY + [0.0, 0.0, 0.0, 1.1, 0.0, 0.0, -0.9]
        fed.feed(joints(leader))
        reading = device.read(1 * MS)
        assert reading.pose is None
        assert reading.problem.startswith(
            "leader and follower differ in joint 4 by 1.10 rad, joint 7 by 0.90 rad, the tool by "
        )
        assert reading.problem.endswith("move the leader until it is less than 0.8 rad, 5 cm and 11 degrees")
        fed.feed(joints(READY + 0.01))
        pose = device.read(2 * MS).pose
        assert pose is not None
        np.testing.assert_allclose(pose, PANDA(READY + 0.01), atol=1e-9)
        # From then on it may go ahead of the follower.
        fed.feed(joints(leader))
        pose = device.read(3 * MS).pose
        assert pose is not None
        np.testing.assert_allclose(pose, PANDA(leader), atol=1e-9)

    @pytest.mark.parametrize(
        ("moved", "opens"),
        [
            (np.eye(7)[4] * 0.79, False),  # Joints are alike enough, but the tool is turned.
            (np.eye(7)[6] * 0.19, True),
            (np.eye(7)[6] * 0.21, False),
            (np.eye(7)[0] * 0.08, True),
            (np.eye(7)[0] * 0.19, False),  # Turned little enough, but centimetres away.
        ],
    )
    def test_the_gate_asks_for_the_tool_as_well(self, make: Make, moved, opens):
        fed, device = make(JOINTS, leader=LeaderConfig(kinematics=PANDA, units="degrees"))
        device.see_follower(READY, PANDA(READY))
        fed.feed(joints(READY + moved))
        reading = device.read(MS)
        assert ((reading.pose is not None), not reading.problem) == (opens, opens)

    def test_the_same_tool_by_other_joints_stays_behind_the_gate(self, make: Make):
        limits = AlignmentLimits(position_m=10.0, rotation_rad=4.0)
        fed, device = make(JOINTS, leader=LeaderConfig(kinematics=PANDA, units="degrees", limits=limits))
        device.see_follower(READY, PANDA(READY))
        for apart, opens in ((0.81, False), (0.79, True)):
            fed.feed(joints(READY + np.eye(7)[2] * apart))
            assert (device.read(MS).pose is not None) == opens

    @pytest.mark.parametrize("gap", ["failure", "nonsense", "silence"])
    def test_the_gate_closes_when_nobody_knows_where_the_leader_went(self, make: Make, gap):
        fed, device = make(JOINTS, leader=LeaderConfig(kinematics=PANDA, units="degrees"))
        device.see_follower(READY, PANDA(READY))
        fed.feed(joints(READY))
        assert device.read(1 * MS).pose is not None
        if gap != "silence":
            fed.feed(ConnectionError("no status packet") if gap == "failure" else {"joint_1.pos": 0.0})
            assert device.read(2 * MS).problem
        fed.feed(joints(READY + 0.5))
        reading = device.read((3 if gap != "silence" else 700) * MS)
        assert "leader and follower differ" in reading.problem

    def test_signs_and_offsets_make_it_the_followers_joints(self, make: Make):
        signs, offsets = (1, -1, 1, -1, 1, 1, -1), tuple(np.linspace(-1.0, 1.0, 7))
        config = LeaderConfig(kinematics=PANDA, units="radians", signs=signs, offsets_rad=offsets)
        fed, device = make({f"j{i}.pos": float for i in range(7)}, leader=config)
        device.see_follower(READY, PANDA(READY))
        said = (READY - offsets) * signs
        fed.feed({f"j{i}.pos": value for i, value in enumerate(said)})
        pose = device.read(MS).pose
        assert pose is not None
        np.testing.assert_allclose(pose, PANDA(READY), atol=1e-12)

    def test_an_arm_of_other_kinematics_is_compared_by_its_tool(self, make: Make):
        def slide(q: np.ndarray) -> np.ndarray:
            return compose(make_pose(np.array([q[0], q[1], 0.3]), np.eye(3)), TOOL)

        fed, device = make({"a.pos": float, "b.pos": float}, leader=LeaderConfig(kinematics=slide, units="radians"))
        device.see_follower(READY, slide(np.array([0.5, 0.0])))
        for a, opens in ((0.4, False), (0.47, True)):
            fed.feed({"a.pos": a, "b.pos": 0.0})
            assert (device.read(MS).pose is not None) == opens

    def test_units_come_from_the_driver_where_it_tells_them(self, make: Make):
        fed, device = make(JOINTS, use_degrees=True, leader=LeaderConfig(kinematics=PANDA))
        device.see_follower(READY, PANDA(READY))
        fed.feed(joints(READY))
        assert device.read(MS).pose is not None

    def test_what_cannot_be_known_is_refused(self, make: Make):
        leader = LeaderConfig(kinematics=PANDA)
        with pytest.raises(
            DeviceError, match="does not tell whether its joints are in degrees or in radians: say which"
        ):
            make(JOINTS, leader=leader)
        with pytest.raises(DeviceError, match="in degrees, and not in radians as was told"):
            make(JOINTS, use_degrees=True, leader=LeaderConfig(kinematics=PANDA, units="radians"))
        with pytest.raises(DeviceError, match=r"leader arm of the joints joint_1, .*: say what its kinematics are"):
            make(JOINTS)
        with pytest.raises(DeviceError, match="takes as many signs"):
            make(JOINTS, leader=LeaderConfig(kinematics=PANDA, units="degrees", signs=(1, -1)))
        with pytest.raises(DeviceError, match="kinematics do not take the 5 joints"):
            make({f"j{i}.pos": float for i in range(5)}, leader=LeaderConfig(kinematics=PANDA, units="degrees"))

    def test_a_share_of_an_unknown_range_is_refused(self, tmp_path):
        fed = Fed(tmp_path, JOINTS)
        fed.bus = SimpleNamespace(
            motors={
                "joint_1": Motor(1, "sts3215", MotorNormMode.RANGE_M100_100),
                "gripper": Motor(2, "sts3215", MotorNormMode.RANGE_0_100),
            }
        )
        with pytest.raises(DeviceError, match=r"says its joints as range_m100_100, .* expected degrees"):
            LeRobotTeleoperator(fed, leader=LeaderConfig(kinematics=PANDA, units="degrees"))


class TestConnect:
    def test_one_that_cannot_move_an_arm_says_what_it_gives(self, tmp_path):
        with pytest.raises(DeviceError, match="gives linear_velocity, expected delta_x"):
            LeRobotTeleoperator(Fed(tmp_path, {"linear_velocity": float}))

    def test_an_unknown_name_is_answered_with_the_nearest(self):
        with pytest.raises(DeviceError, match=r"unknown teleoperator 'so101_leadr'\. Did you mean 'so101_leader'"):
            connect("so101_leadr", {})

    def test_settings_of_something_else_are_refused(self):
        with pytest.raises(DeviceError, match="'so101_leader': unknown setting"):
            connect("so101_leader", {"port": "/dev/null", "colour": "red"})

    @pytest.mark.parametrize(("kind", "setting"), [("so101_leader", "port"), ("phone", "phone_os")])
    def test_a_driver_that_is_not_installed_says_what_to_install(self, kind, setting, tmp_path, capsys):
        settings = {setting: "android", "id": "mine", "calibration_dir": str(tmp_path)}
        said = rf"the driver of the teleoperator '{kind}' is not installed: '.*' is required .*pip install"
        with pytest.raises(DeviceError, match=said):
            connect(kind, settings)
        assert capsys.readouterr().out == ""

    def test_a_port_without_a_leader_says_what_to_do(self, tmp_path, monkeypatch):
        class Unplugged(Fed):
            def connect(self, calibrate: bool = True) -> None:
                raise ConnectionError("no such port: /dev/ttyACM0")

        monkeypatch.setattr(
            "lerobot.teleoperators.make_teleoperator_from_config", lambda _: Unplugged(tmp_path, JOINTS)
        )
        said = r"'so101_leader' cannot be connected \(no such port: /dev/ttyACM0\): .*lerobot-find-port"
        with pytest.raises(DeviceError, match=said):
            connect("so101_leader", {"port": "/dev/ttyACM0"}, leader=LeaderConfig(kinematics=PANDA))

    def test_a_driver_that_connects_to_nothing_is_refused(self):
        # LeRobot's own gamepad logs that there is none, counts as connected, and fails whenever it is asked.
        ran = subprocess.run([sys.executable, "-c", NO_GAMEPAD], capture_output=True, text=True, check=False)
        assert (ran.returncode, ran.stdout) == (0, "the teleoperator 'gamepad' is connected to nothing\n1\n"), (
            ran.stderr
        )

    def test_a_driver_that_waits_for_whoever_holds_it_is_not_waited_for(self, make: Make, monkeypatch):
        monkeypatch.setattr(lerobot_teleoperator, "_FIRST_S", 0.05)
        _, device = make(DELTAS)
        device.require_there()
        assert device.read(5).t_ns == 0

    def test_one_failure_at_the_start_is_none(self, make: Make):
        fed, device = make(DELTAS)
        fed.feed(TimeoutError("no answer"))
        later = threading.Timer(0.1, fed.feed, [deltas(0.5)])
        later.start()
        device.require_there()
        later.join()
        assert device.read(5).counts[0] == 500

    def test_without_lerobot_it_says_what_to_install(self, monkeypatch):
        monkeypatch.setitem(sys.modules, "lerobot.teleoperators", None)
        with pytest.raises(DeviceError, match=r"'phone' is driven by LeRobot.*install lerobot>=0\.6"):
            connect("phone", {})

    def test_its_own_gamepad_moves_an_arm_and_talks_on_stderr(self):
        # In a process of its own: LeRobot ends SDL when it lets go of the pad.
        source, harness = Path(wrenchflow.__file__).parents[1], Path(__file__).parents[1] / "harness"
        environment = {**os.environ, "PYTHONPATH": f"{source}{os.pathsep}{harness}", "SDL_AUDIODRIVER": "dummy"}
        ran = subprocess.run(
            [sys.executable, "-c", OWN_GAMEPAD], capture_output=True, text=True, check=False, env=environment
        )
        assert (ran.returncode, ran.stdout) == (0, "lerobot-gamepad [1000, 0, 0, 0, 0, 0]\n"), ran.stderr
        assert "Gamepad controls" in ran.stderr


NO_GAMEPAD = """
import threading
from wrenchflow.collect.devices.lerobot_teleoperator import connect
from wrenchflow.errors import DeviceError

try:
    connect("gamepad", {})
except DeviceError as error:
    print(str(error).partition(" (")[0])
print(threading.active_count())  # Nobody goes on to ask it.
"""

OWN_GAMEPAD = """
import time
from contextlib import suppress
from wrenchflow.collect.devices.gamepad import open_gamepad
from wrenchflow.collect.devices.lerobot_teleoperator import connect
from wrenchflow.errors import DeviceError
from hands.virtual_pad import VirtualPad

with suppress(DeviceError):
    open_gamepad()
pad = VirtualPad()
device = connect("gamepad", {"use_gripper": True})
pad.move(1, -32768)
until = time.monotonic() + 30.0
while not (counts := device.read(time.monotonic_ns()).counts).any() and time.monotonic() < until:
    time.sleep(0.01)
print(device.name, counts.tolist())
device.close()
"""
