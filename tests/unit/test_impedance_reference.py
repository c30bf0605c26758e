"""The compiled law against an independent one in numpy and scipy, and against itself without the compiler."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import scipy.linalg
from scipy.spatial.transform import Rotation

from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.control.controller import Controller
from wrenchflow.control.records import CTL, OBS


class Reference:
    """The same controller, written from its description: arrays, no state but what the law needs."""

    def __init__(self, rig, config: ControlConfig, obs):
        self.rig, self.config = rig, config
        self.x_d, self.R_d, self.q_null = obs["x"].copy(), Rotation.from_matrix(obs["R"]), obs["q"].copy()
        self.tau, self.k, self.segment = np.zeros(7), 0, 0

    def ask(self, start, stop, ticks, impedance):
        self.start, self.stop, self.ticks, self.impedance, self.segment = start, stop, ticks, impedance, 0

    def target(self):
        self.segment += 1
        share = min(1.0, self.segment / self.ticks)
        R_start, R_stop = (Rotation.from_quat(pose[3:], scalar_first=True) for pose in (self.start, self.stop))
        turn = Rotation.from_rotvec(share * (R_stop * R_start.inv()).as_rotvec())
        return self.start[:3] + share * (self.stop[:3] - self.start[:3]), turn * R_start

    def reference(self, obs, K_lin, K_rot):
        x_target, R_target = self.target()
        R, c = Rotation.from_matrix(obs["R"]), self.config
        leash = c.force_max_n / K_lin
        self.x_d = np.clip(self.x_d, obs["x"] - leash, obs["x"] + leash)
        inside = np.clip(x_target, self.rig.workspace.min_m, self.rig.workspace.max_m)
        step = np.clip(inside, obs["x"] - leash, obs["x"] + leash) - self.x_d
        self.x_d = self.x_d + step * min(1.0, c.speed_max_m_s * 1e-3 / max(np.linalg.norm(step), 1e-300))

        def within(turned, centre, angle):
            vector = (turned * centre.inv()).as_rotvec()
            return Rotation.from_rotvec(vector * min(1.0, angle / max(np.linalg.norm(vector), 1e-300))) * centre

        self.R_d = within(self.R_d, R, c.moment_max_nm / K_rot)
        self.R_d = within(within(R_target, R, c.moment_max_nm / K_rot), self.R_d, c.turn_max_rad_s * 1e-3)

    def design(self, obs, K_lin, K_rot):
        J, M = obs["J"], obs["M"]
        mobility = J @ np.linalg.solve(M, J.T) + 1e-6 * np.eye(6)
        self.D = np.zeros((6, 6))
        for half, K in ((slice(0, 3), K_lin), (slice(3, 6), K_rot)):
            inertia = np.linalg.inv(mobility[half, half])
            squares, V = scipy.linalg.eigh(K * np.eye(3), inertia)
            Q = inertia @ V
            self.D[half, half] = 2.0 * self.impedance.damping_ratio * Q * np.sqrt(squares) @ Q.T
        self.P = np.linalg.solve(mobility, J @ np.linalg.inv(M))

    def tick(self, obs):
        c = self.config
        K_lin = min(self.impedance.translation_n_m, c.stiffness_max_n_m)
        K_rot = min(self.impedance.rotation_nm_rad, c.stiffness_max_nm_rad)
        self.reference(obs, K_lin, K_rot)
        if self.k % round(1000 / c.damping_design_hz) == 0:
            self.design(obs, K_lin, K_rot)
        e = np.concatenate([self.x_d - obs["x"], (self.R_d * Rotation.from_matrix(obs["R"]).inv()).as_rotvec()])
        spring = min(1.0, self.k / (c.ramp_s * 1000)) * np.repeat([K_lin, K_rot], 3) * e
        for half, cap in ((slice(0, 3), c.force_max_n), (slice(3, 6), c.moment_max_nm)):
            spring[half] *= min(1.0, cap / max(np.linalg.norm(spring[half]), 1e-300))
        F = spring - self.D @ (obs["J"] @ obs["dq"])
        null = c.nullspace_nm_rad * (self.q_null - obs["q"]) - 2.0 * np.sqrt(c.nullspace_nm_rad) * obs["dq"]
        tau = obs["J"].T @ F + null - obs["J"].T @ (self.P @ null) + obs["coriolis"]
        limit = np.array(self.rig.robot.torque_nm) * c.torque_share
        step = np.array(self.rig.robot.torque_rate_nm_s) * c.torque_rate_share * 1e-3
        self.tau = np.clip(np.clip(np.clip(tau, -limit, limit), self.tau - step, self.tau + step), -limit, limit)
        self.k += 1
        return self.tau


def segments(start: np.ndarray):
    """Targets that turn, jump, leave the workspace and are pressed into the block, with soft and stiff springs."""
    rng = np.random.default_rng(5)
    for stiff, ticks in ((600.0, 50), (200.0, 1), (5000.0, 100), (600.0, 80), (900.0, 150)):
        move = np.concatenate([rng.normal(size=3) * [0.05, 0.05, 0.03], Rotation.random(rng=rng).as_rotvec() * 0.1])
        turn = Rotation.from_rotvec(move[3:]) * Rotation.from_quat(start[3:], scalar_first=True)
        stop = np.concatenate([start[:3] + move[:3], turn.as_quat(scalar_first=True)])
        yield start, stop, ticks, Impedance(translation_n_m=stiff, rotation_nm_rad=stiff / 20.0, damping_ratio=0.8)
        start = stop


def test_in_closed_loop_the_compiled_law_is_the_reference(peg_plant, rig):
    config = ControlConfig(ramp_s=0.3)
    ours, controller, _ = peg_plant(4, control=config)
    theirs, other, _ = peg_plant(4, control=config)
    reference = Reference(rig, config, controller.obs[0])
    worst = 0.0
    for start, stop, ticks, impedance in segments(controller.target_pose):
        controller.ask(start, stop, ticks=ticks, impedance=impedance)
        reference.ask(start, stop, ticks, impedance)
        for _ in range(160):
            ours.read(controller.obs)
            theirs.read(other.obs)
            tau, expected = controller.tick(), reference.tick(other.obs[0])
            worst = max(worst, np.abs(tau - expected).max())
            state = controller.ctl[0]
            np.testing.assert_allclose(state["x_d"], reference.x_d, atol=1e-12)
            np.testing.assert_allclose(state["R_d"], reference.R_d.as_matrix(), atol=1e-12)
            ours.write(tau)
            theirs.write(expected)
    assert worst < 1e-9
    np.testing.assert_allclose(ours.data.qpos, theirs.data.qpos, atol=1e-12)


def recorded_observations(peg_plant, ticks: int) -> tuple[np.ndarray, np.ndarray]:
    """What a controller saw, and all that it became, tick by tick."""
    plant, controller, _ = peg_plant(6)
    begun = controller.obs.copy()
    seen, became = np.zeros(ticks + 1, OBS), np.zeros(ticks, CTL)
    seen[0] = begun[0]
    asked = segments(controller.target_pose)
    for k in range(ticks):
        if k % 40 == 0:
            start, stop, length, impedance = next(asked)
            controller.ask(start, stop, ticks=length, impedance=impedance)
        plant.read(controller.obs)
        plant.write(controller.tick())
        seen[k + 1], became[k] = controller.obs[0], controller.ctl[0]
    return seen, became


PLAIN = """
import sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from test_impedance_reference import segments
from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.control.controller import Controller
from wrenchflow.control.impedance import tick
from wrenchflow.control.records import CTL
from wrenchflow.rig import load_rig
assert type(tick).__name__ == "function"
seen = np.load("seen.npy")
controller = Controller(load_rig("panda_peg"), ControlConfig())
controller.obs[0] = seen[0]
controller.start(Impedance())
asked, became = segments(controller.target_pose), np.zeros(len(seen) - 1, CTL)
for k in range(len(became)):
    if k % 40 == 0:
        start, stop, length, impedance = next(asked)
        controller.ask(start, stop, ticks=length, impedance=impedance)
    controller.obs[0] = seen[k + 1]
    controller.tick()
    became[k] = controller.ctl[0]
np.save("became.npy", became)
"""


def test_without_the_compiler_every_bit_of_the_controllers_state_is_the_same(peg_plant, tmp_path: Path):
    seen, became = recorded_observations(peg_plant, 160)
    np.save(tmp_path / "seen.npy", seen)
    plain = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    command = [sys.executable, "-c", PLAIN, str(Path(__file__).parent)]
    subprocess.run(command, env=plain, cwd=tmp_path, check=True)
    without = np.load(tmp_path / "became.npy")
    for name in CTL.names:
        np.testing.assert_array_equal(without[name], became[name], err_msg=name)


def test_a_batch_of_controllers_is_as_many_single_ones(peg_plant, rig):
    from wrenchflow.control import impedance as law

    seen, _became = recorded_observations(peg_plant, 3)
    single = Controller(rig, ControlConfig())
    single.obs[0] = seen[0]
    single.start(Impedance())
    ctl, req = np.repeat(single.ctl, 4), np.repeat(single.req, 4)
    req["x_stop"][2] += 0.01
    law.tick_each(np.repeat(single.obs, 4), req, ctl)
    single.tick()
    assert ctl[[0, 1, 3]].tobytes() == np.repeat(single.ctl, 3).tobytes()
    assert ctl[2].tobytes() != single.ctl[0].tobytes()
