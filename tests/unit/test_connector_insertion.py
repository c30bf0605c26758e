"""The plug and its socket: they fit when turned to fit, the latch gives as it should, and too much force is judged."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from wrenchflow.collect import operators_table
from wrenchflow.collect.config import CollectConfig
from wrenchflow.collect.scripted import Scripted
from wrenchflow.collect.session import Session, demonstrate
from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.control.controller import Controller
from wrenchflow.process.config import ProcessConfig
from wrenchflow.process.pipeline import process_episode
from wrenchflow.sim.attempt import Attempt
from wrenchflow.sim.plant import Plant
from wrenchflow.sim.reach import joints_at
from wrenchflow.sim.tasks import scenery
from wrenchflow.sim.tasks.task import Scene
from wrenchflow.spatial import compose, exp_so3, inverse, log_so3, make_pose, rotation_of

TASK, RIG, MODEL = scenery("connector-insertion")
GOAL = make_pose(np.array(TASK.centre_m), exp_so3(np.array([np.pi, 0.0, 0.0])))


def at(x_m: float = 0.0, y_m: float = 0.0, depth_m: float = 0.0, yaw_deg: float = 0.0) -> np.ndarray:
    """A TCP pose by its place in the socket."""
    return compose(GOAL, make_pose(np.array([x_m, y_m, depth_m]), exp_so3(np.array([0.0, 0.0, np.radians(yaw_deg)]))))


def placed(T_base_tcp: np.ndarray) -> tuple[Scene, mujoco.MjData]:
    """The socket in the middle of its range, seen where it is, and the plug at a pose."""
    scene = Scene(q_start_rad=joints_at(MODEL, T_base_tcp), T_base_goal=GOAL, T_base_goal_perceived=GOAL)
    data = mujoco.MjData(MODEL)
    TASK.place(MODEL, data, scene)
    return scene, data


def overlap_at(*place: float) -> float:
    """Deepest overlap of plug and socket [m]; 0 when they do not touch."""
    return float(-min([0.0, *placed(at(*place))[1].contact.dist]))


def jacobian(data: mujoco.MjData) -> np.ndarray:
    """Of the TCP, linear first. Shape (6, 7)."""
    J = np.zeros((6, MODEL.nv))
    mujoco.mj_jacSite(MODEL, data, J[:3], J[3:], MODEL.site("tcp").id)
    return J


def resists(data: mujoco.MjData) -> float:
    """Force out of the socket that its contacts put on the plug [N]."""
    return float(np.linalg.lstsq(jacobian(data).T, data.qfrc_constraint, rcond=None)[0][2])


def push_at(depth_m: float, speed_m_s: float = 0.0, braked_m_s2: float = 0.0) -> float:
    """What a plug meets that is there, goes in at a speed, and is braked, without friction of its walls [N]."""
    _, data = placed(at(depth_m=depth_m))
    inwards = np.linalg.pinv(jacobian(data))[:, 2] * -1.0
    data.qvel[:], data.qacc[:] = inwards * speed_m_s, inwards * -braked_m_s2
    mujoco.mj_inverse(MODEL, data)
    return resists(data)


def coast(speed_m_s: float, push_n: float) -> tuple[np.ndarray, np.ndarray]:
    """Depths [m] and forces [N] of a plug that comes in as on rails, with the arm's mass behind it and a steady push.

    Seen until it is past the crest, or turns back.
    """
    _, data = placed(at(depth_m=0.0042))
    mass = np.zeros((MODEL.nv, MODEL.nv))
    mujoco.mj_fullM(MODEL, data, mass)
    # By a blow on the TCP along the rails: the arm's other motions are left alone.
    J = jacobian(data)
    to_velocity = np.linalg.solve(mass, J.T) @ np.linalg.inv(J @ np.linalg.solve(mass, J.T))
    data.qvel[:] = to_velocity @ [0.0, 0.0, -speed_m_s, 0.0, 0.0, 0.0]
    start, seen = data.site("tcp").xpos.copy(), []
    for _ in range(400):
        mujoco.mj_step1(MODEL, data)
        J, x, R = jacobian(data), data.site("tcp").xpos, data.site("tcp").xmat.reshape(3, 3)
        twist = J @ data.qvel
        force = np.concatenate(
            [600.0 * (start - x) - 80.0 * twist[:3], 20.0 * log_so3(rotation_of(GOAL[3:]) @ R.T) - 1.5 * twist[3:]]
        )
        force[2] = -push_n
        data.ctrl[:] = J.T @ force + data.qfrc_bias - data.qfrc_gravcomp
        depth_m = GOAL[2] - x[2]
        mujoco.mj_step2(MODEL, data)
        if depth_m > TASK.shape.crest_m or twist[2] > 0.0:
            break
        seen.append((depth_m, resists(data)))
    depths, forces = np.array(seen).T
    return depths, forces


def judged(*poses: np.ndarray, force_n: float = 0.0):
    """A referee who has seen poses, each for 0.1 s, and a force throughout."""
    referee = TASK.referee(placed(at(depth_m=-0.01))[0])
    wrench = np.zeros((20, 6))
    wrench[:, 2] = -force_n
    for pose in poses:
        referee.see(np.repeat(pose[None], 20, axis=0), wrench)
    return referee


@pytest.fixture(scope="module")
def pushed(perfect):
    """Push a plug straight down from a start at rest, and see what a referee sees: depths [m], forces [N], verdict."""
    quiet = replace(RIG, sensor=replace(RIG.sensor, noise_force_n=0.0, noise_torque_nm=0.0))

    def push(start: np.ndarray, way_m: float, speed_m_s: float):
        scene, data = placed(start)
        plant = Plant(MODEL, data, quiet, perfect, np.random.default_rng(0), capacity_s=12.0)
        controller = Controller(quiet, ControlConfig())
        controller.set_contact_zone(*TASK.contact_zone(scene))
        plant.begin(controller, Impedance())
        plant.advance(controller, 1200)
        start = controller.target_pose
        ticks = round(1000 * way_m / speed_m_s)
        controller.ask(start, start - [0, 0, way_m, 0, 0, 0, 0], ticks=ticks, impedance=Impedance())
        plant.advance(controller, ticks + 500)
        referee = TASK.referee(scene)
        referee.see(plant.seen["tcp_pose"], plant.seen["wrench"])
        return GOAL[2] - plant.seen["tcp_pose"][:, 2], np.linalg.norm(plant.seen["wrench"][:, :3], axis=1), referee

    return push


@pytest.mark.parametrize("depth_m", [-0.005, 0.0, 0.0005, 0.002, 0.004])
def test_aligned_the_plug_slides_in_without_a_touch(depth_m):
    assert overlap_at(0.0, 0.0, depth_m) == 0.0


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_the_play_is_the_clearance_on_each_side(axis, side):
    for share in (0.9, 1.1):
        beside = [0.0, 0.0]
        beside[axis] = side * share * TASK.shape.clearance_m
        assert overlap_at(*beside, 0.003) == pytest.approx(max(share - 1.0, 0.0) * TASK.shape.clearance_m, abs=1e-7)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_turned_by_more_than_the_play_it_does_not_fit(sign):
    assert overlap_at(0.0, 0.0, 0.003, sign * 1.8) == 0.0
    assert overlap_at(0.0, 0.0, 0.003, sign * 3.0) > 5e-5
    assert overlap_at(0.0, 0.0, 0.0001, sign * 7.0) == 0.0  # The chamfers still take it,
    assert overlap_at(0.0, 0.0, 0.0001, sign * 10.0) == pytest.approx(0.0001, abs=1e-6)  # and here the flat bears it.


def test_pressed_while_turned_beyond_the_capture_it_stays_out(pushed):
    depth, _, referee = pushed(at(depth_m=-0.002, yaw_deg=11.0), 0.03, 0.03)
    assert depth.max() < 0.0005
    assert referee.failure in ("missed", "jammed")


@pytest.mark.parametrize(("share", "goes_in"), [(0.0, True), (0.7, True), (1.5, False)])
def test_it_falls_in_by_itself_only_within_the_capture(pushed, share, goes_in):
    assert TASK.shape.capture_m == pytest.approx(0.00105)
    depth, _, _ = pushed(at(y_m=share * TASK.shape.capture_m, depth_m=-0.002), 0.012, 0.03)
    assert (depth[-1] > 0.003) == goes_in


def test_the_latch_resists_and_then_pulls():
    crest_m = TASK.shape.crest_m
    assert push_at(crest_m - 0.0015) == pytest.approx(0.0, abs=1e-6)
    rising = [push_at(depth) for depth in np.linspace(crest_m - 0.0012, crest_m - 0.0008, 5)]
    assert (np.diff(rising) > 0.0).all()
    assert 10.0 < max(push_at(depth) for depth in np.linspace(crest_m - 0.0010, crest_m - 0.0004, 7)) < 16.0
    assert push_at(crest_m) == pytest.approx(0.0, abs=0.01)
    assert push_at(crest_m + 0.0002) < -2.0
    assert push_at(crest_m + 0.0012) > 15.0  # Rubber.


@pytest.mark.parametrize("short_of_m", [0.0010, 0.0009, 0.0007, 0.0004])
def test_what_the_latch_answers_follows_from_the_depth_whoever_comes(short_of_m):
    depth_m = TASK.shape.crest_m - short_of_m
    at_rest_n = push_at(depth_m)
    assert at_rest_n > 2.0
    # The arm weighs 5 kg here, so this is what 12 N do to it.
    assert push_at(depth_m, braked_m_s2=2.4) == pytest.approx(at_rest_n, rel=0.05)
    assert push_at(depth_m, speed_m_s=0.035) == pytest.approx(at_rest_n, rel=0.1)


@pytest.mark.parametrize(("speed_m_s", "push_n"), [(0.02, 10.0), (0.035, 5.0), (0.06, 0.0)])
def test_coasting_over_the_crest_takes_the_force_and_the_work_of_a_slow_push(speed_m_s, push_n):
    way = np.linspace(TASK.shape.crest_m - 0.0016, TASK.shape.crest_m, 50)
    slow = np.array([push_at(depth) for depth in way])
    depths, forces = coast(speed_m_s, push_n)
    assert depths[-1] > TASK.shape.crest_m - 1e-4
    assert forces.max() == pytest.approx(slow.max(), rel=0.1)
    assert np.trapezoid(forces, depths) == pytest.approx(np.trapezoid(slow, way), rel=0.15)


def test_momentum_of_less_than_the_work_of_the_crest_is_thrown_back():
    depths, forces = coast(0.05, 0.0)
    assert depths.max() < TASK.shape.crest_m - 1e-4
    assert forces.max() > 12.0


@pytest.mark.parametrize("speed_m_s", [0.01, 0.03])
def test_pushed_in_the_force_rises_to_the_crest_falls_and_stays_below_the_limit(pushed, speed_m_s):
    depth, force, referee = pushed(at(depth_m=0.002), 0.03, speed_m_s)
    past = int(np.argmax(depth > TASK.shape.crest_m))
    assert past > 0
    crest_n = force[:past].max()
    assert 12.5 < crest_n < 14.5
    assert force[past : past + 40].min() < 0.6 * crest_n
    assert force.max() < 20.0
    assert depth[-1] > TASK.seated_m
    assert referee.progress == 1.0


def test_led_by_hand_on_a_soft_arm_the_crest_takes_no_less():
    episode = demonstrate(0, CollectConfig(task="connector-insertion", operator="hand-guided", seed=3))
    assert episode.meta["result"]["success"]
    wrench, tcp = process_episode(episode, ProcessConfig())[0]["wrench"], episode["tcp_pose"]
    crest_ns = tcp.t[np.argmax(tcp.data[:, 2] < GOAL[2] - TASK.shape.crest_m)]
    before = (wrench.t > crest_ns - 200_000_000) & (wrench.t < crest_ns)
    assert 12.5 < np.linalg.norm(wrench.data[before, :3], axis=1).max() < 14.5
    assert np.linalg.norm(wrench.data[:, :3], axis=1).max() < 24.0


def test_less_than_the_crest_leaves_it_unseated(pushed):
    depth, force, referee = pushed(at(depth_m=0.002), 0.018, 0.01)  # That is 9 N.
    assert force.max() < 11.0
    assert depth.max() < TASK.shape.crest_m
    assert referee.failure == "unseated"
    assert referee.progress < 1.0


def test_scenes_are_drawn_within_their_ranges():
    rng = np.random.default_rng(0)
    scenes = [TASK.draw(MODEL, rng) for _ in range(150)]
    goals = np.array([scene.T_base_goal for scene in scenes])
    offsets = goals[:, :3] - TASK.centre_m
    assert 0.023 < np.abs(offsets[:, :2]).max() <= TASK.position_range_m
    assert (offsets[:, 2] == 0.0).all()
    yaw = log_so3(rotation_of(goals[:, 3:]) @ exp_so3(np.array([-np.pi, 0.0, 0.0])))
    assert np.radians(18.0) < np.abs(yaw[:, 2]).max() <= TASK.yaw_range_rad
    wrong = [compose(inverse(scene.T_base_goal), scene.T_base_goal_perceived) for scene in scenes]
    np.testing.assert_allclose(np.std([pose[:2] for pose in wrong], axis=0), TASK.perception_sigma_m, rtol=0.2)
    turns = np.array([log_so3(rotation_of(pose[3:])) for pose in wrong])
    np.testing.assert_allclose(turns[:, 2].std(), TASK.perception_sigma_rad, rtol=0.2)
    np.testing.assert_allclose(turns[:, :2], 0.0, atol=1e-9)


def test_seated_is_what_stays_past_the_crest():
    seated = at(depth_m=0.0066)
    assert judged(seated).progress == pytest.approx(1.0)
    referee = TASK.referee(placed(at(depth_m=-0.01))[0])
    for _ in range(10):  # Bouncing off the stop is not seated.
        referee.see(at(depth_m=0.0055)[None], np.zeros((1, 6)))
        referee.see(np.repeat(seated[None], 15, axis=0), np.zeros((15, 6)))
        assert referee.progress < 1.0
    assert judged(at(depth_m=TASK.shape.crest_m)).progress < 0.9
    assert judged(at(x_m=0.003, depth_m=0.0066)).progress < 0.9  # Beside the socket, depth counts for nothing.


def test_every_failure_has_its_name():
    named = {
        judged(at(depth_m=0.0066), force_n=31.0).failure,
        judged(at(depth_m=0.0050)).failure,
        judged(at(depth_m=0.0004)).failure,
        judged(at(x_m=0.002, depth_m=0.0)).failure,
        judged(at(depth_m=-0.02)).failure,
    }
    assert named == set(TASK.failures)
    assert judged(at(depth_m=0.0050)).failure == "unseated"
    assert judged(at(depth_m=0.0004)).failure == "jammed"
    assert judged(at(x_m=0.002)).failure == "missed"
    assert judged(at(depth_m=-0.02)).failure == "timeout"


def test_too_much_force_is_lost_for_ever():
    assert not judged(at(depth_m=0.005), force_n=29.9).is_lost
    referee = judged(at(depth_m=0.005), force_n=30.1)
    assert referee.is_lost
    referee.see(np.repeat(at(depth_m=0.0066)[None], 100, axis=0), np.zeros((100, 6)))
    assert (referee.is_lost, referee.failure) == (True, "over-force")
    assert referee.progress < 1.0


def test_the_scripted_operator_seats_it_gently():
    for index in range(2):
        episode = demonstrate(index, CollectConfig(task="connector-insertion", seed=3))
        assert episode.meta["result"]["success"], episode.meta["result"]
        phases = [event.label for event in episode.events_of("phase")]
        assert phases[:2] == ["tare", "approach"]
        assert phases[-1] == "snap"
        assert "search" in phases or "insert" in phases


def test_without_feeling_it_is_not_done(monkeypatch):
    class Numb(Scripted):
        def want(self, perception):
            return super().want(replace(perception, wrench=np.zeros(6), wrench_mean=np.zeros(6)))

    config, task = CollectConfig(task="connector-insertion"), replace(TASK, time_limit_s=4.0)
    numb = Numb(task.name, task.phases, config.impedance)
    monkeypatch.setattr(operators_table, "make_operator", lambda config: numb)
    for index in range(2):
        attempt = Attempt(task, MODEL, RIG, config, seed=(3, index, 0))
        session = Session(attempt, config)
        while not attempt.over:
            session.period()
        assert not attempt.outcome.success
