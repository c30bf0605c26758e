"""What every `Robot` keeps to: one class of rules over the simulated arm and over a small fake one."""

import numpy as np
import pytest

from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.control.controller import TICK_NS, Controller
from wrenchflow.control.records import OBS
from wrenchflow.control.robot import Robot

# In the middle of the joints' ranges, so that the rig's limits suit it.
HOME = np.array([0.0, 0.0, 0.0, -1.5, 0.0, 1.5, 0.0])


class Gantry:
    """Three slides along the base axes, a turntable about z and three joints that move nothing; no gravity."""

    adds_gravity = True
    adds_friction = True
    INERTIA = np.array([4.0, 4.0, 5.0, 0.1, 0.1, 0.1, 0.1])

    def __init__(self) -> None:
        self.t_ns, self.q, self.dq, self.tau = 5_000_000_000, np.zeros(7), np.zeros(7), np.zeros(7)

    def read(self, obs: np.ndarray) -> None:
        state, c, s = obs[0], np.cos(self.q[3]), np.sin(self.q[3])
        state["t_ns"], state["q"], state["dq"], state["tau"] = self.t_ns, self.q + HOME, self.dq, self.tau
        state["x"] = np.array([0.5, 0.0, 0.3]) + self.q[:3]
        state["R"] = [[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]
        state["J"] = np.zeros((6, 7))
        state["J"][[0, 1, 2, 5], [0, 1, 2, 3]] = 1.0
        state["M"] = np.diag(self.INERTIA)

    def write(self, tau: np.ndarray) -> None:
        self.tau = np.array(tau)
        self.dq += self.tau / self.INERTIA * 1e-3
        self.q += self.dq * 1e-3
        self.t_ns += TICK_NS


@pytest.fixture(params=["plant", "gantry"])
def robot(request, peg_plant, perfect, quiet_rig) -> Robot:
    if request.param == "gantry":
        return Gantry()
    return peg_plant(measurement=perfect, with_rig=quiet_rig)[0]


class TestRobot:
    """The rules."""

    def test_it_says_what_its_hardware_adds(self, robot: Robot):
        assert isinstance(robot.adds_gravity, bool)
        assert isinstance(robot.adds_friction, bool)

    def test_what_is_read_is_finite_and_consistent(self, robot: Robot):
        obs = np.zeros(1, OBS)
        obs["R"] = np.nan
        robot.read(obs)
        state = obs[0]
        for name in OBS.names:
            assert np.isfinite(state[name]).all(), name
        np.testing.assert_allclose(state["R"] @ state["R"].T, np.eye(3), atol=1e-9)
        assert np.linalg.det(state["R"]) == pytest.approx(1.0)
        np.testing.assert_allclose(state["M"], state["M"].T, atol=1e-9)
        assert np.linalg.eigvalsh(state["M"]).min() > 0.0

    def test_time_goes_on_by_a_tick(self, robot: Robot):
        obs, stamps = np.zeros(1, OBS), []
        for _ in range(5):
            robot.read(obs)
            stamps.append(int(obs["t_ns"][0]))
            robot.write(np.zeros(7))
        np.testing.assert_array_equal(np.diff(stamps), TICK_NS)

    def test_without_torque_an_arm_at_rest_stays(self, robot: Robot):
        obs = np.zeros(1, OBS)
        robot.read(obs)
        start = obs["q"][0].copy()
        for _ in range(200):
            robot.write(np.zeros(7))
            robot.read(obs)
        np.testing.assert_allclose(obs["q"][0], start, atol=1e-6)

    def test_the_jacobian_says_how_the_pose_moves(self, robot: Robot):
        before, after = np.zeros(1, OBS), np.zeros(1, OBS)
        torque = np.linspace(-0.4, 0.4, 7)
        for _ in range(50):
            robot.read(before)
            robot.write(torque)
        robot.read(after)
        moved = before["J"][0] @ (after["q"] - before["q"])[0]
        np.testing.assert_allclose((after["x"] - before["x"])[0], moved[:3], atol=1e-7)
        turn = after["R"][0] @ before["R"][0].T
        np.testing.assert_allclose([turn[2, 1], turn[0, 2], turn[1, 0]], moved[3:], atol=1e-6)
        np.testing.assert_allclose((after["q"] - before["q"])[0] * 1e3, after["dq"][0], rtol=1e-2, atol=1e-6)

    def test_torque_accelerates_by_the_inertia_that_is_read(self, robot: Robot):
        obs = np.zeros(1, OBS)
        robot.read(obs)
        torque, before = np.linspace(0.5, -0.5, 7), obs["dq"][0].copy()
        predicted = np.linalg.solve(obs["M"][0], torque - obs["coriolis"][0]) * 1e-3
        robot.write(torque)
        robot.read(obs)
        np.testing.assert_allclose(obs["dq"][0] - before, predicted, rtol=0.02, atol=1e-7)
        np.testing.assert_allclose(obs["tau"][0], torque, atol=1e-12)

    def test_the_core_brings_it_to_a_target(self, robot: Robot, quiet_rig):
        controller = Controller(quiet_rig, ControlConfig(ramp_s=0.1))
        robot.read(controller.obs)
        controller.start(Impedance())
        target = controller.target_pose
        target[:3] += [0.01, -0.01, 0.005]
        controller.ask(controller.target_pose, target, ticks=200, impedance=Impedance())
        for _ in range(2500):
            robot.write(controller.tick())
            robot.read(controller.obs)
        np.testing.assert_allclose(controller.obs["x"][0], target[:3], atol=3e-4)
        assert controller.mode == "run"
