"""The peg and its hole: they fit, the capture is narrow, and the scene is drawn as it is said to be."""

import numpy as np
import pytest

from wrenchflow.control.config import Impedance
from wrenchflow.errors import ConfigError, ControlError
from wrenchflow.sim.reach import joints_at
from wrenchflow.sim.tasks import NAMES, make_task
from wrenchflow.sim.tasks.task import Scene
from wrenchflow.spatial import IDENTITY_POSE, compose, exp_so3, log_so3, make_pose, rotation_of


def centred(peg, model) -> Scene:
    """The hole in the middle of its range and seen where it is."""
    rng = np.random.default_rng(0)
    goal = make_pose(np.array(peg.centre_m), exp_so3(np.array([np.pi, 0.0, 0.0])))
    return Scene(q_start_rad=peg.draw(model, rng).q_start_rad, T_base_goal=goal, T_base_goal_perceived=goal)


def contact_at(peg, model, offset_m: float, angle: float, depth_m: float) -> float:
    """Deepest overlap of peg and block [m] with the tip off the axis; 0 when they do not touch."""
    import mujoco

    scene = centred(peg, model)
    data = mujoco.MjData(model)
    peg.place(model, data, scene)
    beside = np.array([offset_m * np.cos(angle), offset_m * np.sin(angle), depth_m])
    data.qpos[:] = joints_at(model, compose(scene.T_base_goal, make_pose(beside, np.eye(3))))
    mujoco.mj_forward(model, data)
    return float(-min([0.0, *data.contact.dist]))


def test_the_capture_radius_is_below_a_millimetre(peg):
    assert peg.capture_radius_m == pytest.approx(0.00085)
    assert 2.0 * peg.clearance_m == pytest.approx(0.0005)
    assert 2.0 * peg.peg_radius_m == pytest.approx(0.020)


@pytest.mark.parametrize("depth_m", [-0.005, 0.0, 0.0005, 0.005, 0.02, 0.029])
def test_on_the_axis_the_peg_slides_in_without_a_touch(peg, peg_model, depth_m):
    assert contact_at(peg, peg_model, 0.0, 0.0, depth_m) == 0.0


@pytest.mark.parametrize("angle", np.linspace(0.0, 2.0 * np.pi, 7, endpoint=False))
def test_the_play_on_the_radius_is_the_clearance_all_around(peg, peg_model, angle):
    # The ring of capsules and the polygon of boxes leave up to a facet's error more: r (1 / cos(pi / 24) - 1).
    facet_m = 0.010 * (1.0 / np.cos(np.pi / 24) - 1.0)
    assert contact_at(peg, peg_model, 0.9 * peg.clearance_m, angle, 0.01) == 0.0
    assert contact_at(peg, peg_model, peg.clearance_m + 2.0 * facet_m, angle, 0.01) > 0.0


@pytest.mark.parametrize("angle", np.linspace(0.0, 2.0 * np.pi, 5, endpoint=False))
def test_a_millimetre_and_a_half_beside_the_axis_the_rim_stands_on_the_block(peg, peg_model, angle):
    assert contact_at(peg, peg_model, 0.0015, angle, -0.0001) == 0.0
    assert contact_at(peg, peg_model, 0.0015, angle, 0.0005) == pytest.approx(0.0005, abs=0.0001)


def test_the_hole_has_a_floor(peg, peg_model):
    assert contact_at(peg, peg_model, 0.0, 0.0, peg.hole_depth_m + 0.0002) == pytest.approx(0.0002, abs=2e-5)


@pytest.mark.parametrize(("offset_m", "goes_in"), [(0.0, True), (0.0006, True), (0.0013, False), (0.003, False)])
def test_pressed_at_an_offset_it_goes_in_only_within_the_capture_radius(
    peg, peg_plant, perfect, quiet_rig, offset_m, goes_in
):
    plant, controller, scene = peg_plant(measurement=perfect, with_rig=quiet_rig)
    above, down = scene.T_base_goal.copy(), scene.T_base_goal.copy()
    above[:3] += [0.0, offset_m, 0.004]
    down[:3] += [0.0, offset_m, -0.025]
    controller.ask(controller.target_pose, above, ticks=800, impedance=Impedance())
    plant.advance(controller, 2200)
    controller.ask(above, down, ticks=2900, impedance=Impedance())
    plant.advance(controller, 3400)
    assert (judged(peg, scene, plant.true_tcp_pose).progress >= 0.9) == goes_in


def test_scenes_are_drawn_within_their_ranges(peg, peg_model):
    rng = np.random.default_rng(0)
    scenes = [peg.draw(peg_model, rng) for _ in range(100)]
    goals = np.array([scene.T_base_goal for scene in scenes])
    offsets = goals[:, :3] - peg.centre_m
    assert np.abs(offsets[:, :2]).max() <= 0.025
    assert np.abs(offsets[:, :2]).max() > 0.023
    assert (offsets[:, 2] == 0.0).all()
    yaw = log_so3(rotation_of(goals[:, 3:]) @ exp_so3(np.array([-np.pi, 0.0, 0.0])))
    assert np.abs(yaw[:, 2]).max() <= np.radians(15.0)
    wrong = np.array([scene.T_base_goal_perceived - scene.T_base_goal for scene in scenes])
    np.testing.assert_allclose(wrong[:, :2].std(0), 0.002, rtol=0.25)
    assert (wrong[:, 2:] == 0.0).all()


def test_the_arm_starts_above_the_perceived_goal_hardly_tilted(peg, peg_plant):
    for seed in range(5):
        plant, _, scene = peg_plant(seed)
        tcp = plant.true_tcp_pose
        from_perceived = tcp[:3] - scene.T_base_goal_perceived[:3]
        assert np.abs(from_perceived[:2]).max() <= 0.020 + 1e-9
        assert 0.035 - 1e-9 <= from_perceived[2] <= 0.055 + 1e-9
        down = rotation_of(tcp[3:])[:, 2]
        assert np.arccos(-down[2]) <= np.radians(1.0) + 1e-9


def test_a_pose_out_of_reach_is_refused(peg_model):
    with pytest.raises(ControlError, match="no joint angles reach the pose"):
        joints_at(peg_model, IDENTITY_POSE + np.array([2.0, 0, 0, 0, 0, 0, 0]))


def judged(peg, scene, T_base_tcp):
    referee = peg.referee(scene)
    referee.see(T_base_tcp[None], np.zeros((1, 6)))
    return referee


def test_progress_and_failures_have_their_names(peg, peg_model):
    scene = centred(peg, peg_model)

    def at(x_m: float, depth_m: float):
        return compose(scene.T_base_goal, make_pose(np.array([x_m, 0.0, depth_m]), np.eye(3)))

    assert judged(peg, scene, at(0.0, -0.01)).progress == 0.0
    assert judged(peg, scene, at(0.0, 0.010)).progress == pytest.approx(0.5)
    assert judged(peg, scene, at(0.0, 0.025)).progress == 1.0
    assert judged(peg, scene, at(0.002, 0.025)).progress == 0.0  # Beside the hole, depth counts for nothing.
    assert judged(peg, scene, at(0.0, 0.010)).failure == "jammed"
    assert judged(peg, scene, at(0.003, 0.0001)).failure == "missed"
    assert judged(peg, scene, at(0.0, -0.03)).failure == "timeout"


def test_every_task_has_a_name_and_keeps_it():
    assert [make_task(name).name for name in NAMES] == list(NAMES)
    with pytest.raises(ConfigError, match="Did you mean 'peg-insertion'"):
        make_task("peg_insertion")
