"""The core on the arm: it holds contact, it loses energy, and it starts and stops without a bump."""

import mujoco
import numpy as np
import pytest

from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.spatial import compose, exp_so3, log_so3, make_pose, rotation_of


def kinetic_and_spring_energy(controller, impedance: Impedance) -> float:
    obs, ctl = controller.obs[0], controller.ctl[0]
    turn = log_so3(ctl["R_d"] @ obs["R"].T)
    spring = impedance.translation_n_m * ((ctl["x_d"] - obs["x"]) ** 2).sum() + impedance.rotation_nm_rad * turn @ turn
    return float(0.5 * obs["dq"] @ obs["M"] @ obs["dq"] + 0.5 * spring)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("damping_ratio", [0.1, 0.9])
def test_with_a_constant_target_in_free_space_energy_never_rises(peg_plant, perfect, quiet_rig, seed, damping_ratio):
    impedance = Impedance(damping_ratio=damping_ratio)
    control = ControlConfig(ramp_s=0.0, nullspace_nm_rad=0.0)
    plant, controller, _ = peg_plant(seed, measurement=perfect, with_rig=quiet_rig, control=control)
    rng = np.random.default_rng(seed)
    moved = make_pose(rng.uniform(-1, 1, 3) * 0.02, exp_so3(rng.normal(size=3) * 0.03))
    moved[2] = -abs(moved[2])  # Up, away from the block: the tool's z points down.
    controller.ask(controller.target_pose, compose(controller.target_pose, moved), ticks=1, impedance=impedance)
    energies = []
    for k in range(2000):
        plant.read(controller.obs)
        plant.write(controller.tick())
        if k > 200:  # By then the reference has arrived.
            energies.append(kinetic_and_spring_energy(controller, impedance))
    assert plant.data.ncon == 0
    # A torque that is held for a millisecond may give back a millionth of what there was.
    assert np.diff(energies).max() < 1e-6 * energies[0]
    assert energies[-1] < (0.25 if damping_ratio < 0.5 else 0.02) * energies[0]


@pytest.mark.parametrize(("below_m", "stiffness_n_m"), [(0.5, 600.0), (0.5, 1500.0), (0.02, 1000.0), (0.02, 200.0)])
def test_static_contact_force_is_never_over_stiffness_times_leash(
    peg_plant, perfect, quiet_rig, below_m, stiffness_n_m
):
    plant, controller, scene = peg_plant(measurement=perfect, with_rig=quiet_rig)
    impedance = Impedance(translation_n_m=stiffness_n_m)
    above, down = scene.T_base_goal.copy(), scene.T_base_goal.copy()
    above[:3] += [0.01, 0.0, 0.003]
    down[:3] += [0.01, 0.0, -below_m]
    controller.ask(controller.target_pose, above, ticks=1000, impedance=impedance)
    plant.advance(controller, 2500)
    controller.ask(above, down, ticks=int(max(below_m, 0.01) * 1e4), impedance=impedance)
    plant.advance(controller, 5000)
    forces, force = [], np.zeros(6)
    for _ in range(300):
        plant.advance(controller, 1)
        total = 0.0
        for i in range(plant.data.ncon):
            mujoco.mj_contactForce(plant.model, plant.data, i, force)
            total += (plant.data.contact[i].frame.reshape(3, 3).T @ force[:3])[2]
        forces.append(abs(total))
    expected = min(25.0, stiffness_n_m * below_m)
    assert np.mean(forces) == pytest.approx(expected, rel=0.05)
    assert np.mean(forces) <= 25.0 * 1.01


def test_a_free_arm_reaches_its_target_and_holds_it(peg_plant, perfect, quiet_rig):
    plant, controller, scene = peg_plant(measurement=perfect, with_rig=quiet_rig)
    hover = scene.T_base_goal.copy()
    hover[2] += 0.02
    controller.ask(controller.target_pose, hover, ticks=1000, impedance=Impedance())
    plant.advance(controller, 5000)
    tcp = plant.true_tcp_pose
    np.testing.assert_allclose(tcp[:3], hover[:3], atol=1e-4)
    np.testing.assert_allclose(rotation_of(tcp[3:]), rotation_of(hover[3:]), atol=1e-3)


def test_the_start_moves_nothing(peg_plant, perfect, quiet_rig):
    plant, controller, _ = peg_plant(measurement=perfect, with_rig=quiet_rig)
    start = plant.true_tcp_pose
    rows = plant.advance(controller, 1500)
    assert np.abs(rows["joint_command"]).max() < 1e-6
    np.testing.assert_allclose(plant.true_tcp_pose, start, atol=1e-9)


def test_a_target_that_jumps_is_followed_within_every_limit(peg_plant, rig):
    plant, controller, _scene = peg_plant(3)
    rng = np.random.default_rng(0)
    for _ in range(40):
        wild = controller.target_pose
        wild[:3] += rng.normal(size=3)
        controller.ask(wild, wild, ticks=1, impedance=Impedance(translation_n_m=rng.uniform(0, 3000)))
        plant.advance(controller, 50)
    tau = plant.recorded["joint_command"]
    assert (np.abs(tau) <= rig.robot.torque_nm).all()
    assert (np.abs(np.diff(tau, axis=0, prepend=0.0)) <= np.array(rig.robot.torque_rate_nm_s) * 1e-3).all()
    assert (np.abs(plant.recorded["joint_states"][:, 7:14]) < rig.robot.velocity_rad_s).all()


def test_after_a_fault_the_arm_is_let_go_of_and_gravity_stays_compensated(peg_plant, perfect, quiet_rig):
    plant, controller, _ = peg_plant(measurement=perfect, with_rig=quiet_rig)
    plant.advance(controller, 200)
    controller.ctl[0]["q_null"] = np.nan  # A fault of our own: no torque can be worked out.
    plant.advance(controller, 1000)
    assert (controller.mode, controller.cause) == ("latched", "gate-torque")
    assert np.abs(plant.recorded["joint_command"][-1]).max() < 0.1  # Nothing but the brake of an arm at rest.
    assert np.abs(plant.data.qvel).max() < 1e-3


def test_after_a_fault_a_moving_arm_is_braked(peg_plant, perfect, quiet_rig):
    plant, controller, _ = peg_plant(measurement=perfect, with_rig=quiet_rig)
    plant.advance(controller, 1200)
    start = controller.target_pose
    away = start.copy()
    away[1] += 0.3
    controller.ask(start, away, ticks=1500, impedance=Impedance())
    plant.advance(controller, 700)
    speed = np.linalg.norm(plant.recorded["tcp_twist"][-1][:3])
    assert speed > 0.1
    controller.ctl[0]["q_null"] = np.nan
    before = plant.recorded["tcp_pose"][-1][:3].copy()
    plant.advance(controller, 3000)
    assert (controller.mode, controller.cause) == ("latched", "gate-torque")
    moved = np.linalg.norm(plant.recorded["tcp_pose"][-700:, :3] - before, axis=1)
    assert moved.max() < 0.15
    assert np.ptp(moved) < 1e-3


def test_starting_again_under_load_keeps_the_rate_limit(peg_plant, perfect, quiet_rig):
    control = ControlConfig(zone_speed_m_s=0.02)  # Landing at once would be an impact, and stop the arm.
    plant, controller, _ = peg_plant(measurement=perfect, with_rig=quiet_rig, control=control)
    down = controller.target_pose
    down[2] -= 0.2
    controller.ask(controller.target_pose, down, ticks=2000, impedance=Impedance())
    plant.advance(controller, 5000)
    before = plant.recorded["joint_command"][-1].copy()
    assert np.abs(before).max() > 3.0
    controller.start(Impedance())
    plant.advance(controller, 1)
    assert (np.abs(plant.recorded["joint_command"][-1] - before) <= controller.ctl[0]["tau_step_max"] + 1e-9).all()


def test_an_arm_that_holds_gets_no_stiffer_and_no_softer(peg_plant, perfect, quiet_rig):
    plant, controller, _ = peg_plant(measurement=perfect, with_rig=quiet_rig)
    pose, ctl = controller.target_pose, controller.ctl[0]
    controller.ask(pose, pose, ticks=1, impedance=Impedance(translation_n_m=200.0, rotation_nm_rad=10.0))
    plant.advance(controller, 2000)
    wanted = Impedance(translation_n_m=1500.0, rotation_nm_rad=50.0, damping_ratio=0.3)
    controller.ask(pose, pose, ticks=1, impedance=wanted, every_s=0.05)
    plant.advance(controller, 1 + 125 + 1)  # The tick that hears it, two and a half times 50 ms, and one more.
    assert controller.mode == "hold"
    kept = [ctl[name].copy() for name in ("K_lin", "K_rot", "damping_ratio")]
    assert 210.0 < kept[0][0, 0] < 1400.0  # It was on its way.
    plant.advance(controller, 500)
    assert controller.mode == "hold"
    for name, value in zip(("K_lin", "K_rot", "damping_ratio"), kept, strict=True):
        np.testing.assert_array_equal(ctl[name], value)
