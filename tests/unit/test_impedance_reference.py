"""The compiled law against an independent one in numpy and scipy, and against itself without the compiler."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from scipy.spatial.transform import Rotation

from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.control.controller import Controller
from wrenchflow.control.records import CTL, OBS


def unit(e, K_lin, K_rot):
    """Potential of a spring, 1/2 e^T K e."""
    return 0.5 * (e[:3] @ K_lin @ e[:3] + e[3:] @ K_rot @ e[3:])


class Reference:
    """The same controller while it runs, written from its description: arrays, no state but what is described."""

    def __init__(self, rig, config: ControlConfig, zone, obs, impedance):
        self.rig, self.config, self.zone = rig, config, zone
        self.x_d, self.R_d, self.q_null = obs["x"].copy(), Rotation.from_matrix(obs["R"]), obs["q"].copy()
        self.q, self.tau, self.k, self.segment = obs["q"].copy(), np.zeros(7), 0, 0
        self.K = [np.eye(3) * impedance.translation_n_m, np.eye(3) * impedance.rotation_nm_rad]
        self.zeta, self.gain, self.parts = impedance.damping_ratio, 0.0, np.zeros((5, 7))
        self.tank, self.spring, self.budget = config.tank_start_j, 0.0, config.tank_start_j

    def ask(self, start, stop, ticks, K, zeta, wrench):
        self.start, self.stop, self.ticks, self.K_asked, self.zeta_asked, self.segment = start, stop, ticks, K, zeta, 0
        self.wrench = wrench

    def target(self):
        self.segment += 1
        share = min(1.0, self.segment / self.ticks)
        R_start, R_stop = (Rotation.from_quat(pose[3:], scalar_first=True) for pose in (self.start, self.stop))
        turn = Rotation.from_rotvec(share * (R_stop * R_start.inv()).as_rotvec())
        return self.start[:3] + share * (self.stop[:3] - self.start[:3]), turn * R_start

    def error(self, obs):
        return np.concatenate([self.x_d - obs["x"], (self.R_d * Rotation.from_matrix(obs["R"]).inv()).as_rotvec()])

    def potential(self, obs):
        return self.gain * unit(self.error(obs), *self.K)

    def pay(self, spring):
        self.tank, self.spring = min(self.tank - (spring - self.spring), self.config.tank_max_j), spring

    @property
    def available(self):
        return max(self.tank - self.config.tank_reserve_j, 0.0)

    def payable(self, power):
        return 1.0 if power * 1e-3 <= self.available else self.available / (power * 1e-3)

    def account(self, obs):
        """The ledger: what each part did over the measured displacement."""
        c, work = self.config, self.parts @ (obs["q"] - self.q)
        after = self.potential(obs)
        cost = work[0] - (self.spring - after) + np.maximum(work[2:], 0.0).sum()
        cost += work[1] * (1.0 if work[1] > 0.0 else c.tank_refill_share)
        self.spring, self.tank = after, min(self.tank - cost + c.tank_fill_w * 1e-3, c.tank_max_j)
        self.budget = min(self.budget - work.sum() + c.tank_fill_w * 1e-3, c.tank_max_j + self.spring)

    def stiffen(self, obs):
        """Range, slew and tank of the stiffness and of the damping ratio."""
        c, e = self.config, self.error(obs)
        low, high = (c.stiffness_min_n_m, c.stiffness_min_nm_rad), (c.stiffness_max_n_m, c.stiffness_max_nm_rad)
        masses, falls = (c.slew_inertia_kg, c.slew_inertia_kg_m2), (c.stiffness_fall_n_m_s, c.stiffness_fall_nm_rad_s)
        wanted = []
        for K, least, most in zip(self.K_asked, low, high, strict=True):
            gains, axes = np.linalg.eigh(K)
            wanted.append(axes @ np.diag(np.clip(gains, least, most)) @ axes.T)
        zeta = np.clip(self.zeta_asked, c.damping_ratio_min, c.damping_ratio_max)
        rises = zeta > self.zeta
        softest = [np.linalg.eigvalsh(K)[0] for K in self.K]
        if rises:
            rate = 0.5 * np.sqrt(min(K / m for K, m in zip(softest, masses, strict=True)))
            zeta = min(zeta, self.zeta + rate * 1e-3)
        self.zeta, share = zeta, 1.0
        for K, target, m, fall, least, soft in zip(self.K, wanted, masses, falls, low, softest, strict=True):
            a = 2.0 * c.damping_ratio_min * np.sqrt(least / m)
            rate = 2.0 * a / (1.0 + a * self.zeta * np.sqrt(m / soft)) * 1e-3 * (0.5 if rises else 1.0)
            share = min(share, rate / max(scipy.linalg.eigvalsh(target - K, K)[-1], 1e-12))
            share = min(share, fall * 1e-3 / max(-np.linalg.eigvalsh(target - K)[0], 1e-12))
        for _ in range(2):  # The second time for what the tank can pay.
            K_new = [K + share * (target - K) for K, target in zip(self.K, wanted, strict=True)]
            cost = self.gain * (unit(e, *K_new) - unit(e, *self.K))
            if cost <= self.available:
                break
            share *= self.available / cost
        self.K = K_new
        self.pay(self.gain * unit(e, *self.K))

    def speed(self, x):
        c = self.config
        beside = np.linalg.norm(np.maximum(np.maximum(self.zone[0] - x, x - self.zone[1]), 0.0))
        return min(c.speed_max_m_s, c.zone_speed_m_s + beside / c.zone_slowing_s)

    def lead(self, obs):
        """The reference: retracted to its leash, then a step that is limited in speed and paid for."""
        (x_target, R_target), R, c = self.target(), Rotation.from_matrix(obs["R"]), self.config
        leash, angle = c.force_max_n / np.abs(self.K[0]).sum(1), c.moment_max_nm / np.abs(self.K[1]).sum(1).max()
        old = self.x_d - obs["x"]

        def within(turned, centre, angle):
            vector = (turned * centre.inv()).as_rotvec()
            return Rotation.from_rotvec(vector * min(1.0, angle / max(np.linalg.norm(vector), 1e-300))) * centre

        self.x_d = obs["x"] + np.clip(old, -leash, leash)
        self.R_d = within(self.R_d, R, angle)
        if self.potential(obs) > self.spring:
            self.x_d = obs["x"] + old * np.min(leash / np.maximum(np.abs(old), leash))
        self.pay(self.potential(obs))
        x, R_before = self.x_d, self.R_d
        inside = np.clip(x_target, self.rig.workspace.min_m, self.rig.workspace.max_m)
        step = np.clip(inside, obs["x"] - leash, obs["x"] + leash) - x
        fastest = min(self.speed(obs["x"]), self.speed(x)) * 1e-3
        step *= min(1.0, fastest / max(np.linalg.norm(step), 1e-300))
        slower = min(self.speed(obs["x"]), self.speed(x + step)) / c.speed_max_m_s
        turn = within(within(R_target, R, angle), self.R_d, slower * c.turn_max_rad_s * 1e-3) * R_before.inv()
        turn = turn.as_rotvec()

        def cost(share):
            self.x_d, self.R_d = x + share * step, Rotation.from_rotvec(share * turn) * R_before
            return self.potential(obs) - self.spring - self.available

        if cost(1.0) > 0.0:
            cost(scipy.optimize.bisect(cost, 0.0, 1.0, xtol=1e-12) if cost(0.0) < 0.0 else 0.0)
        self.pay(self.potential(obs))

    def design(self, obs):
        J, M = obs["J"], obs["M"]
        mobility = J @ np.linalg.solve(M, J.T) + 1e-6 * np.eye(6)
        self.D, self.inertia = np.zeros((6, 6)), np.zeros((6, 6))
        for half, K in zip((slice(0, 3), slice(3, 6)), self.K, strict=True):
            self.inertia[half, half] = inertia = np.linalg.inv(mobility[half, half])
            squares, V = scipy.linalg.eigh(K, inertia)
            Q = inertia @ V
            self.D[half, half] = 2.0 * self.zeta * Q * np.sqrt(squares) @ Q.T
        self.P = np.linalg.solve(mobility, J @ np.linalg.inv(M))

    def tick(self, obs):
        c = self.config
        if self.k > 0:
            self.account(obs)
        rest = unit(self.error(obs), *self.K)
        self.gain = min(1.0, self.k / (c.ramp_s * 1000), self.gain + self.available / max(rest, 1e-300))
        self.pay(self.gain * rest)
        self.stiffen(obs)
        if self.k % round(1000 / c.damping_design_hz) == 0:
            self.design(obs)
        self.lead(obs)
        e, J, V = self.error(obs), obs["J"], obs["J"] @ obs["dq"]
        spring = self.gain * np.concatenate([self.K[0] @ e[:3], self.K[1] @ e[3:]])
        damping = -self.D @ V
        fast = self.speed(obs["x"])
        for half, fastest in ((slice(0, 3), fast), (slice(3, 6), fast / c.speed_max_m_s * c.turn_max_rad_s)):
            speed = np.linalg.norm(V[half])
            excess = max(0.0, 1.0 - c.arm_speed_share * fastest / max(speed, 1e-300))
            damping[half] -= excess / c.brake_s * self.inertia[half, half] @ V[half]
        null = c.nullspace_nm_rad * (self.q_null - obs["q"]) - 2.0 * np.sqrt(c.nullspace_nm_rad) * obs["dq"]
        null -= J.T @ (self.P @ null)
        posed = null * self.payable(null @ obs["dq"]) + obs["coriolis"]
        fed = self.gain * self.wrench
        for half, cap in ((slice(0, 3), c.force_max_n), (slice(3, 6), c.moment_max_nm)):
            fed[half] *= min(1.0, cap / max(np.linalg.norm(fed[half]), 1e-300))
        fed = fed * self.payable(fed @ V)
        if fed @ V > 0.0:
            limit = c.arm_speed_share * self.speed(obs["x"]) * np.array([1.0, c.turn_max_rad_s / c.speed_max_m_s])
            over = (np.linalg.norm(V.reshape(2, 3), axis=1) / limit).max()
            fed = fed * np.clip(2.0 * (1.0 - over), 0.0, 1.0)
        both = spring + fed
        for half, cap in ((slice(0, 3), c.force_max_n), (slice(3, 6), c.moment_max_nm)):
            both[half] *= min(1.0, cap / max(np.linalg.norm(both[half]), 1e-300))
        limit = np.array(self.rig.robot.torque_nm) * c.torque_share
        step = np.array(self.rig.robot.torque_rate_nm_s) * c.torque_rate_share * 1e-3
        damped = J.T @ damping
        taken = -0.5e-3 * (np.abs(damped) / step).max() * damped @ obs["dq"]
        if taken > 0.25 * obs["dq"] @ obs["M"] @ obs["dq"]:
            damped = damped * np.sqrt(0.25 * obs["dq"] @ obs["M"] @ obs["dq"] / taken)
        tau = J.T @ both + damped + posed
        self.tau = np.clip(np.clip(np.clip(tau, -limit, limit), self.tau - step, self.tau + step), -limit, limit)
        parts = [J.T @ spring, damped, J.T @ fed, posed]
        self.parts, self.q = np.array([*parts, self.tau - sum(parts)]), obs["q"].copy()
        self.k += 1
        return self.tau


def segments(start: np.ndarray):
    """Targets that turn, jump, leave the workspace and are pressed into the block, with soft and stiff springs."""
    rng = np.random.default_rng(5)
    for stiff, ticks, far in ((600.0, 50, 1), (200.0, 1, 10), (5000.0, 100, 1), (600.0, 80, 1), (900.0, 150, 1)):
        move = np.concatenate(
            [rng.normal(size=3) * [0.05 * far, 0.05, 0.03], Rotation.random(rng=rng).as_rotvec() * 0.1]
        )
        turn = Rotation.from_rotvec(move[3:]) * Rotation.from_quat(start[3:], scalar_first=True)
        stop = np.concatenate([start[:3] + move[:3], turn.as_quat(scalar_first=True)])
        yield start, stop, ticks, Impedance(translation_n_m=stiff, rotation_nm_rad=stiff / 20.0, damping_ratio=0.8)
        start = stop


# With a tank that pays for little, both find by search how much it is, to so many digits.
@pytest.mark.parametrize(
    ("tank", "near"), [({}, 1e-9), ({"tank_start_j": 0.06, "tank_max_j": 0.08, "tank_fill_w": 0.05}, 1e-9)]
)
def test_in_closed_loop_the_compiled_tick_is_the_reference(peg, peg_plant, rig, tank, near):
    config = ControlConfig(ramp_s=0.3, **tank)
    ours, controller, scene = peg_plant(4, control=config)
    theirs, other, _ = peg_plant(4, control=config)
    reference = Reference(rig, config, peg.contact_zone(scene), controller.obs[0], Impedance())
    worst, axes = 0.0, Rotation.from_rotvec([0.4, -0.7, 0.3]).as_matrix()
    acted = set()
    for number, (start, stop, ticks, impedance) in enumerate(segments(controller.target_pose)):
        controller.ask(
            start, stop, ticks=ticks, impedance=impedance, wrench=np.array([3.0, -2, 1, 0.2, 0, 0.1]) * number
        )
        # Stiff along one axis that is none of the base's, soft along another.
        controller.req[0]["K_lin"] = axes @ np.diag([1.0, 0.3, 2.0]) @ axes.T * impedance.translation_n_m
        req = controller.req[0]
        K = [np.array((K + K.T) / 2.0) for K in (req["K_lin"], req["K_rot"])]
        reference.ask(start, stop, ticks, K, impedance.damping_ratio, req["wrench"].copy())
        for _ in range(160):
            ours.read(controller.obs)
            theirs.read(other.obs)
            tau, expected = controller.tick(), reference.tick(other.obs[0])
            acted |= set(controller.acting)
            worst = max(worst, np.abs(tau - expected).max())
            state = controller.ctl[0]
            np.testing.assert_allclose(state["x_d"], reference.x_d, atol=near)
            np.testing.assert_allclose(state["R_d"], reference.R_d.as_matrix(), atol=near)
            np.testing.assert_allclose([state["K_lin"], state["K_rot"]], reference.K, rtol=near, atol=near)
            for name in ("tank", "spring", "budget"):
                assert state[name] == pytest.approx(getattr(reference, name), abs=10 * near), name
            ours.write(tau)
            theirs.write(expected)
    assert controller.mode == "run"
    assert worst < 1e3 * near
    np.testing.assert_allclose(ours.data.qpos, theirs.data.qpos, atol=near)
    # What the comparison is worth: nearly everything that limits has done so.
    assert acted >= {"stiffness-range", "stiffness-slew", "leash", "speed", "turn", "contact-zone", "workspace"}
    assert ({"tank-reference", "tank-torque"} <= acted) == bool(tank)


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
controller.set_contact_zone(*np.load("zone.npy"))
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
    np.save(tmp_path / "zone.npy", [became[0]["zone_min"], became[0]["zone_max"]])
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
    single.ask(single.target_pose, single.target_pose, ticks=1, impedance=Impedance())
    ctl, req = np.repeat(single.ctl, 4), np.repeat(single.req, 4)
    req["x_stop"][2] += 0.01
    law.tick_each(np.repeat(single.obs, 4), req, np.repeat(single.schedule, 4), ctl)
    single.tick()
    assert ctl[[0, 1, 3]].tobytes() == np.repeat(single.ctl, 3).tobytes()
    assert ctl[2].tobytes() != single.ctl[0].tobytes()
