"""What the wrist sensor feels is physics: weight, pushes and acceleration, with the sign of robot on environment."""

import copy

import mujoco
import numpy as np
import pytest

from wrenchflow.control.config import Impedance
from wrenchflow.control.records import OBS

WEIGHT_N = 0.45 * 9.81
COM_M = np.array([0.0, 0.0, 0.05])


@pytest.fixture(scope="module")
def free_model(peg_model):
    """The arm without contacts, so that it may be put anywhere."""
    model = copy.copy(peg_model)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_LIMIT
    return model


@pytest.fixture(scope="module")
def falling_model(free_model):
    """The same without gravity compensation."""
    model = copy.copy(free_model)
    model.body_gravcomp[:] = 0.0
    return model


def reading(model, data) -> np.ndarray:
    """Force and moment that MuJoCo has for the sensor."""
    mujoco.mj_forward(model, data)
    return data.sensordata.copy()


def placed(model, q: np.ndarray, dq: np.ndarray | float = 0.0):
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = q, dq
    return data


def anywhere(rig, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(rig.robot.position_min_rad, rig.robot.position_max_rad)


def sensor_axes(data) -> np.ndarray:
    return data.site("sensor").xmat.reshape(3, 3)


@pytest.mark.parametrize("seed", range(8))
def test_a_hanging_tool_reads_its_weight_and_its_moment(peg_plant, free_model, perfect, quiet_rig, seed):
    q = anywhere(quiet_rig, seed)
    plant, _controller, _ = peg_plant(model=free_model, measurement=perfect, with_rig=quiet_rig, q_rad=q)
    obs = np.zeros(1, OBS)
    plant.read(obs)
    force = sensor_axes(plant.data).T @ [0.0, 0.0, WEIGHT_N]
    np.testing.assert_allclose(obs["wrench"][0, :3], force, atol=1e-6)
    np.testing.assert_allclose(obs["wrench"][0, 3:], np.cross(COM_M, force), atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_a_push_of_the_environment_reads_as_the_robot_pushing_back(free_model, rig, seed):
    rng, q = np.random.default_rng(seed), anywhere(rig, seed)
    data = placed(free_model, q)
    before = reading(free_model, data)
    push = rng.normal(size=3) * 10.0
    tool = free_model.body("tool").id
    data.xfrc_applied[tool, :3] = push
    # The joints hold against it, so that nothing moves.
    linear = np.zeros((3, 7))
    mujoco.mj_jacBodyCom(free_model, data, linear, None, tool)
    data.qfrc_applied[:] = -linear.T @ push
    tared = reading(free_model, data) - before
    on_environment = -sensor_axes(data).T @ push
    np.testing.assert_allclose(tared[:3], on_environment, atol=1e-6)
    np.testing.assert_allclose(tared[3:], np.cross(COM_M, on_environment), atol=1e-6)


def test_a_push_against_the_running_controller_is_read_to_a_hundredth(peg_plant, perfect, quiet_rig):
    plant, controller, _ = peg_plant(measurement=perfect, with_rig=quiet_rig)
    plant.advance(controller, 1500)
    before = plant.recorded["wrench_raw"][-1].copy()
    plant.data.xfrc_applied[plant.model.body("tool").id, :3] = [0.0, 3.0, -5.0]
    rows = plant.advance(controller, 3000)
    axes = sensor_axes(plant.data)
    np.testing.assert_allclose(axes @ (rows["wrench_raw"][-1] - before)[:3], [0.0, -3.0, 5.0], atol=0.05)


def test_pressing_down_on_the_block_is_a_negative_force(peg_plant, perfect, quiet_rig):
    plant, controller, scene = peg_plant(measurement=perfect, with_rig=quiet_rig)
    above, down = scene.T_base_goal.copy(), scene.T_base_goal.copy()
    above[:3] += [0.004, 0.0, 0.004]
    down[:3] += [0.004, 0.0, -8.0 / 600.0]
    controller.ask(controller.target_pose, above, ticks=1000, impedance=Impedance())
    plant.advance(controller, 2000)
    before = plant.recorded["wrench_raw"][-1].copy()
    controller.ask(above, down, ticks=1000, impedance=Impedance())
    rows = plant.advance(controller, 2500)
    pressed = sensor_axes(plant.data) @ (rows["wrench_raw"][-200:].mean(0) - before)[:3]
    assert pressed[2] == pytest.approx(-8.0, abs=0.3)
    # What the joints feel is the same: J^T f is the torque that the arm exerts on the environment.
    by_joints = np.linalg.lstsq(controller.obs["J"][0].T, rows["external_torque"][-200:].mean(0), rcond=None)[0]
    assert by_joints[2] == pytest.approx(-8.0, abs=0.3)


@pytest.mark.parametrize("seed", range(4))
def test_a_tool_in_free_fall_reads_nothing(falling_model, rig, seed):
    data = placed(falling_model, anywhere(rig, seed))
    mujoco.mj_forward(falling_model, data)
    tool, jacobian, M = falling_model.body("tool").id, np.zeros((6, 7)), np.zeros((7, 7))
    mujoco.mj_jacBodyCom(falling_model, data, jacobian[:3], jacobian[3:], tool)
    mujoco.mj_fullM(falling_model, data, M)
    fall = np.linalg.lstsq(jacobian, np.array([0.0, 0.0, -9.81, 0.0, 0.0, 0.0]), rcond=None)[0]
    data.qfrc_applied[:] = M @ fall + data.qfrc_bias
    np.testing.assert_allclose(reading(falling_model, data), 0.0, atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_an_arm_that_drops_reads_mass_times_acceleration_without_gravity(falling_model, rig, seed):
    rng = np.random.default_rng(seed)
    q, dq = anywhere(rig, seed), rng.normal(size=7)
    data = placed(falling_model, q, dq)
    felt = reading(falling_model, data)[:3]
    ddq, h = data.qacc.copy(), 1e-4
    tool = falling_model.body("tool").id

    def com(t: float) -> np.ndarray:
        moved = placed(falling_model, q + t * dq + 0.5 * t * t * ddq)
        mujoco.mj_kinematics(falling_model, moved)
        return moved.xipos[tool].copy()

    acceleration = (com(h) - 2.0 * com(0.0) + com(-h)) / h**2
    expected = sensor_axes(data).T @ (0.45 * (acceleration + [0.0, 0.0, 9.81]))
    np.testing.assert_allclose(felt, expected, atol=1e-5)
