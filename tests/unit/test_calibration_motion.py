from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from wrenchflow.collect.calibration_motion import run_motion
from wrenchflow.collect.calibration_poses import plan_poses, turn_between
from wrenchflow.errors import CalibrationError
from wrenchflow.process.calibrate_config import MotionConfig
from wrenchflow.process.calibration import estimate_bias
from wrenchflow.process.mount import SensorMount
from wrenchflow.process.payload import condition_of
from wrenchflow.process.rests import marked_rests
from wrenchflow.rig import RIGS, Payload, load_rig
from wrenchflow.sim.free_space import free_space
from wrenchflow.sim.reach import can_go
from wrenchflow.sim.tasks.task import make_model

TRUTH = Payload(mass_kg=0.8, com_sensor_m=(0.01, -0.02, 0.06))


@pytest.fixture(scope="module")
def motion():
    return run_motion(load_rig("panda_peg"), TRUTH, seed=1)


@pytest.mark.parametrize("name", RIGS)
def test_the_poses_tell_a_payload_and_lie_within_joints_and_workspace(name):
    rig = load_rig(name)
    scene = free_space(rig, rig.payload)
    poses = plan_poses(rig, np.array(scene.home), 6, partial(can_go, make_model(scene, rig), rig.robot))
    assert condition_of(SensorMount(rig).orientation(poses[:, 3:])) < 10.0
    assert (poses[:, :3] >= rig.workspace.min_m).all()
    assert (poses[:, :3] <= rig.workspace.max_m).all()
    assert min(turn_between(a, b) for i, a in enumerate(poses) for b in poses[:i]) > 0.2


def test_the_arm_rests_at_each_pose_for_as_long_as_asked(motion):
    rests = marked_rests(motion)
    assert len(rests) == 6
    assert motion.meta["result"]["success"]
    assert motion.meta["safety"]["entered"] == {}
    rig = load_rig("panda_peg")
    for start_ns, stop_ns in rests:
        assert stop_ns - start_ns >= 1_400_000_000
        joints = motion["joint_states"].between(start_ns, stop_ns).data
        assert np.abs(joints[:, 7:14]).max() < 0.01
        assert np.ptp(joints[:, :7], axis=0).max() < 0.003
        low, high = np.array(rig.robot.position_min_rad), np.array(rig.robot.position_max_rad)
        assert ((low + 0.1 < joints[:, :7]) & (joints[:, :7] < high - 0.1)).all()


def test_nothing_but_the_true_payload_hangs_below_the_sensor(motion):
    rig = load_rig("panda_peg")
    true_rig = replace(rig, payload=TRUTH)
    streams = (motion["wrench_raw"], motion["tcp_pose"], motion["joint_states"])
    true_bias = np.array(motion.meta["simulator"]["sensor"]["bias_end"])
    for start_ns, stop_ns in marked_rests(motion):
        bias = estimate_bias(*streams, true_rig, start_ns=start_ns, stop_ns=stop_ns)
        np.testing.assert_allclose(bias.mean[:3], true_bias[:3], atol=0.1)
        np.testing.assert_allclose(bias.mean[3:], true_bias[3:], atol=0.004)


def test_the_same_seed_is_the_same_recording_and_another_is_not():
    rig, short = load_rig("panda_peg"), MotionConfig(poses=4, rest_s=1.0)
    one, again, other = (run_motion(rig, TRUTH, seed=seed, config=short) for seed in (1, 1, 2))
    assert all(again[name] == one[name] for name in one.streams)
    assert other["wrench_raw"] != one["wrench_raw"]


def test_an_arm_that_cannot_tilt_its_tool_is_refused():
    rig = load_rig("panda_peg")
    q = np.array([0.0, -0.19, 0.0, -2.03, 0.0, 1.84, 0.78])
    narrow = replace(rig, robot=replace(rig.robot, position_min_rad=tuple(q - 0.3), position_max_rad=tuple(q + 0.3)))
    with pytest.raises(CalibrationError, match=r"reaches .* ways to hold the tool .* expected 6 at least"):
        run_motion(narrow, TRUTH)


def test_an_arm_that_does_not_come_to_rest_in_time_is_refused():
    with pytest.raises(CalibrationError, match=r"does not come to rest at pose 2 of 6"):
        run_motion(load_rig("panda_peg"), TRUTH, config=MotionConfig(turn_rad_s=1.0, settle_max_s=0.75))
