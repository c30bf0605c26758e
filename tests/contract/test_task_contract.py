"""One class of rules over every task: what attempts, operators and the command line rest on."""

from functools import cache
from itertools import pairwise

import mujoco
import numpy as np
import pytest

from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.operators import Perception
from wrenchflow.collect.scripted import Scripted
from wrenchflow.collect.session import Session
from wrenchflow.control.config import Impedance
from wrenchflow.control.records import JOINTS
from wrenchflow.rig import RIGS, load_rig
from wrenchflow.sim.attempt import DEMONSTRATE, Attempt
from wrenchflow.sim.panda import TIMESTEP_S
from wrenchflow.sim.tasks import NAMES, make_task, scenery
from wrenchflow.sim.tasks.task import Referee, Scene, Task, mjcf_of
from wrenchflow.spatial import compose, inverse, log_so3, rotation_of


@pytest.fixture(scope="module", params=NAMES)
def name(request) -> str:
    return request.param


@pytest.fixture(scope="module")
def scene_of(name):
    """Draw the scene of a seed."""
    task, _, model = scenery(name)
    return lambda seed: task.draw(model, np.random.default_rng(seed))


def placed(name: str, scene: Scene) -> mujoco.MjData:
    task, _, model = scenery(name)
    data = mujoco.MjData(model)
    task.place(model, data, scene)
    return data


def arrays(scene: Scene) -> list[np.ndarray]:
    return [scene.q_start_rad, scene.T_base_goal, scene.T_base_goal_perceived]


class TestEveryTask:
    def test_it_keeps_to_the_protocol_and_to_its_name(self, name):
        task = make_task(name)
        assert isinstance(task, Task)
        assert task.name == name

    def test_its_rig_comes_along_and_holds_its_tool(self, name):
        task, rig, model = scenery(name)
        assert task.rig in RIGS
        assert rig == load_rig(task.rig)
        assert model.body("tool").mass[0] == pytest.approx(rig.payload.mass_kg)
        np.testing.assert_allclose(model.body("tool").ipos, rig.payload.com_sensor_m)

    def test_its_phases_and_failures_have_names_of_their_own(self, name):
        task = make_task(name)
        for names in (task.phases, task.failures):
            assert len(names) > 0
            assert len(set(names)) == len(names)
            assert all(names)
        assert "timeout" in task.failures
        assert 1.0 <= task.time_limit_s <= 60.0
        assert 5.0 <= task.force_limit_n <= 40.0

    def test_its_model_has_the_arms_joints_and_no_others(self, name):
        model = scenery(name)[2]
        assert (model.nq, model.nv, model.nu) == (JOINTS, JOINTS, JOINTS)
        assert model.opt.timestep == TIMESTEP_S
        for site in ("tcp", "flange", "sensor", "goal"):
            assert mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, site) >= 0

    def test_its_model_for_people_is_the_same(self, name):
        task, rig, model = scenery(name)
        told = mujoco.MjModel.from_xml_string(mjcf_of(task, rig))
        assert (told.ngeom, told.nbody, told.nmocap) == (model.ngeom, model.nbody, model.nmocap)
        np.testing.assert_allclose(told.geom_solimp, model.geom_solimp)
        np.testing.assert_allclose(told.geom_friction, model.geom_friction)

    def test_a_draw_follows_from_its_generator_alone(self, name, scene_of):
        first, again, other = scene_of(7), scene_of(7), scene_of(8)
        for a, b, c in zip(arrays(first), arrays(again), arrays(other), strict=True):
            np.testing.assert_array_equal(a, b)
            assert not np.array_equal(a, c)

    def test_what_is_perceived_is_near_what_is_so_and_not_the_same(self, name, scene_of):
        for seed in range(20):
            scene = scene_of(seed)
            assert not np.array_equal(scene.T_base_goal, scene.T_base_goal_perceived)
            wrong = compose(inverse(scene.T_base_goal_perceived), scene.T_base_goal)
            assert np.linalg.norm(wrong[:3]) < 0.02
            assert np.linalg.norm(log_so3(rotation_of(wrong[3:]))) < 0.3
            for pose in (scene.T_base_goal, scene.T_base_goal_perceived):
                assert np.linalg.norm(pose[3:]) == pytest.approx(1.0, abs=1e-12)
                assert rotation_of(pose[3:])[2, 2] < -0.9  # z goes into the surface.

    def test_the_goal_is_where_the_scene_says(self, name, scene_of):
        scene = scene_of(3)
        site = placed(name, scene).site("goal")
        np.testing.assert_allclose(site.xpos, scene.T_base_goal[:3], atol=1e-12)
        np.testing.assert_allclose(site.xmat.reshape(3, 3), rotation_of(scene.T_base_goal[3:]), atol=1e-9)

    def test_an_attempt_begins_above_the_goal_and_touches_nothing(self, name, scene_of):
        _, rig, _ = scenery(name)
        for seed in range(20):
            scene = scene_of(seed)
            data = placed(name, scene)
            assert data.ncon == 0
            np.testing.assert_array_equal(data.qpos, scene.q_start_rad)
            from_goal = data.site("tcp").xpos - scene.T_base_goal_perceived[:3]
            assert 0.01 < from_goal[2] < 0.1
            assert np.abs(from_goal[:2]).max() < 0.05
            low, high = rig.robot.position_min_rad, rig.robot.position_max_rad
            assert (scene.q_start_rad > np.array(low) + 0.2).all()
            assert (scene.q_start_rad < np.array(high) - 0.2).all()
            assert (data.site("tcp").xpos > rig.workspace.min_m).all()
            assert (data.site("tcp").xpos < rig.workspace.max_m).all()

    def test_the_contact_zone_holds_the_goal_as_it_seems_and_as_it_is(self, name, scene_of):
        task = make_task(name)
        for seed in range(20):
            scene = scene_of(seed)
            low, high = task.contact_zone(scene)
            for goal in (scene.T_base_goal_perceived, scene.T_base_goal):
                assert (low < goal[:3]).all()
                assert (goal[:3] < high).all()

    def test_the_contact_zone_follows_from_what_is_perceived(self, name, scene_of):
        task, scene = make_task(name), scene_of(0)
        elsewhere = Scene(
            q_start_rad=scene.q_start_rad,
            T_base_goal=scene.T_base_goal + np.array([0.01, 0.01, 0.01, 0, 0, 0, 0]),
            T_base_goal_perceived=scene.T_base_goal_perceived,
        )
        np.testing.assert_array_equal(task.contact_zone(elsewhere), task.contact_zone(scene))

    def test_nothing_is_done_and_nothing_lost_before_it_begins(self, name, scene_of):
        task, scene = make_task(name), scene_of(0)
        referee = task.referee(scene)
        assert isinstance(referee, Referee)
        above = scene.T_base_goal_perceived - np.array([0.0, 0.0, -0.05, 0, 0, 0, 0])
        for samples in (0, 1, 200):
            referee.see(np.repeat(above[None], samples, axis=0), np.zeros((samples, 6)))
            assert (referee.progress, referee.is_lost) == (0.0, False)
            assert referee.failure in task.failures

    def test_its_referee_sees_the_same_in_one_look_as_in_many(self, name):
        attempt = self._demonstrated(name)
        seen = attempt.plant.seen
        at_once, bit_by_bit = (attempt.task.referee(attempt.scene) for _ in range(2))
        at_once.see(seen["tcp_pose"], seen["wrench"])
        for start, stop in pairwise([0, 1, 7, 100, 101, len(seen)]):
            bit_by_bit.see(seen["tcp_pose"][start:stop], seen["wrench"][start:stop])
        for judged in ("progress", "failure", "is_lost"):
            assert getattr(at_once, judged) == getattr(bit_by_bit, judged)
        assert at_once.progress == attempt.outcome.progress

    def test_an_emulated_person_does_it_and_the_attempt_ends_when_it_is_done(self, name):
        attempt = self._demonstrated(name)
        assert attempt.outcome.success
        assert attempt.outcome.failure == ""
        seen = attempt.plant.seen
        before = attempt.task.referee(attempt.scene)
        before.see(seen["tcp_pose"][:-1], seen["wrench"][:-1])
        assert before.progress < 1.0

    @staticmethod
    @cache
    def _demonstrated(name: str) -> Attempt:
        config = CollectConfig(task=name, operator="emulated", profiles=("steady",))
        task, rig, model = scenery(name)
        attempt = Attempt(task, model, rig, config, seed=(0, 0, DEMONSTRATE))
        Session(attempt, config).run()
        return attempt

    def test_someone_knows_how_to_do_it(self, name, scene_of):
        task, scene = make_task(name), scene_of(0)
        operator = Scripted(name, task.phases, Impedance())
        site = placed(name, scene).site("tcp")
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, site.xmat)
        seen = Perception(
            t_s=0.0,
            tcp_pose=np.concatenate([site.xpos, quat]),
            goal_pose=scene.T_base_goal_perceived,
            wrench=np.zeros(6),
            wrench_mean=np.zeros(6),
        )
        wanted, phase = operator.want(seen)
        assert phase == task.phases[0]
        assert wanted[2] < site.xpos[2]
        assert np.linalg.norm(wanted[3:]) == pytest.approx(1.0)
