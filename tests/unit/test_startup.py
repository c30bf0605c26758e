"""Start-up checks: a sound cell passes anywhere on the task, and every planted fault is told for what it is."""

import json
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from wrenchflow.config import to_mapping
from wrenchflow.control.config import ControlConfig, Impedance
from wrenchflow.control.controller import Controller
from wrenchflow.control.robot import Robot
from wrenchflow.control.startup import StartupReport, check_startup
from wrenchflow.errors import StartupError
from wrenchflow.sim.tasks.task import make_model
from wrenchflow.spatial import exp_so3, quat_of


class Faulty:
    """A robot with something wrong: `seen` may change what is read, `done` what is commanded, at each tick."""

    adds_gravity = True
    adds_friction = True

    def __init__(
        self,
        robot: Robot,
        seen: Callable[[np.void, int], None] = lambda state, tick: None,
        done: Callable[[np.ndarray, int], np.ndarray] = lambda tau, tick: tau,
    ) -> None:
        self.robot, self.seen, self.done, self.tick = robot, seen, done, 0

    def read(self, obs: np.ndarray) -> None:
        self.robot.read(obs)
        self.seen(obs[0], self.tick)

    def write(self, tau: np.ndarray) -> None:
        self.robot.write(self.done(tau, self.tick))
        self.tick += 1


def check(robot: Robot, rig) -> StartupReport:
    return check_startup(robot, Controller(rig, ControlConfig()), rig)


def refused(robot: Robot, rig) -> str:
    with pytest.raises(StartupError) as error:
        check(robot, rig)
    return str(error.value)


@pytest.mark.parametrize("seed", range(4))
def test_a_sound_cell_passes_wherever_the_task_starts(peg_plant, rig, seed):
    plant, _, _ = peg_plant(seed)
    start = plant.true_tcp_pose
    report = check(plant, rig)
    assert report.mass_kg == pytest.approx(0.45, abs=0.03)
    assert report.compliance == pytest.approx((1.0, 1.0, 1.0), abs=0.05)
    assert report.strength == pytest.approx(1.0, abs=0.05)
    assert report.kinematics_m < 1e-4
    assert report.noise == pytest.approx(tuple(rig.sensor.noise), rel=0.15)
    assert plant.data.ncon == 0
    np.testing.assert_allclose(plant.true_tcp_pose[:3], start[:3], atol=5e-4)  # It is back where it was.


def test_what_is_found_can_be_recorded_and_is_the_same_from_the_same_seed(peg_plant, rig):
    reports = [check(peg_plant(7)[0], rig) for _ in range(2)]
    assert reports[0] == reports[1]
    told = json.loads(json.dumps(to_mapping(reports[0]), allow_nan=False))
    assert told["mass_kg"] == reports[0].mass_kg
    assert len(told["noise"]) == 6


def test_a_sensor_without_noise_is_not_dead_where_the_rig_says_so(peg_plant, perfect, quiet_rig):
    report = check(peg_plant(measurement=perfect, with_rig=quiet_rig)[0], quiet_rig)
    assert report.mass_kg == pytest.approx(0.45, abs=1e-3)
    assert report.strength == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("mass_kg", [0.0, 0.35, 0.6, 1.5])
def test_a_payload_that_the_rig_states_wrongly_is_told_with_both_masses(peg_plant, rig, mass_kg):
    wrong = replace(rig, payload=replace(rig.payload, mass_kg=mass_kg))
    message = refused(peg_plant()[0], wrong)
    assert message.startswith("the tool is not the rig's: got 0.4")
    assert f"expected payload.mass_kg {mass_kg:g} kg within" in message


def test_a_tool_that_is_missing_is_told(peg_plant, peg, rig):
    without = replace(rig, payload=replace(rig.payload, mass_kg=1e-3))
    message = refused(peg_plant(model=make_model(peg, without))[0], rig)
    assert message.startswith("the tool is not the rig's: got 0.0")
    assert "expected payload.mass_kg 0.45 kg within 0.0675 kg" in message


def test_a_sensor_mounted_otherwise_than_the_rig_says_is_told(peg_plant, rig):
    quarter = tuple(quat_of(exp_so3(np.array([0.0, 0.0, np.pi / 2]))).tolist())
    turned = replace(rig, sensor=replace(rig.sensor, T_flange_sensor=(0.0, 0.0, 0.03, *quarter)))
    assert "or a sensor mounted otherwise" in refused(peg_plant()[0], turned)


def dead(state: np.void, tick: int) -> None:
    state["wrench"] = 0.0


def fluttering(state: np.void, tick: int) -> None:
    state["wrench"] = 0.01 * (tick % 2)


def half_dead(state: np.void, tick: int) -> None:
    state["wrench"][4] = 0.02 + 1e-5 * (tick % 2)


def at_its_range(state: np.void, tick: int) -> None:
    state["wrench"][2] = np.clip(state["wrench"][2] + 300.0, -200.0, 200.0) - 0.2 * (tick % 2)


def shifted(state: np.void, tick: int) -> None:
    state["wrench"][2] += 190.0


def not_a_number(state: np.void, tick: int) -> None:
    state["wrench"][0] = np.nan


def noisy(rng: np.random.Generator) -> Callable[[np.void, int], None]:
    def seen(state: np.void, tick: int) -> None:
        state["wrench"][1] += rng.normal() * 1.0

    return seen


@pytest.mark.parametrize(
    ("seen", "message"),
    [
        (dead, "control stopped the arm during the checks: the force sensor froze or died: stopped softly"),
        (fluttering, "got a noise of 0.00501 N in fx at rest, expected from 0.04 to 0.62 N: it is dead or frozen."),
        (half_dead, "N.m in ty at rest, expected from 0.0014 to 0.023 N.m: it is dead or frozen."),
        (noisy(np.random.default_rng(0)), "N in fy at rest, expected from 0.04 to 0.62 N: it is disturbed, or"),
        (at_its_range, "the force sensor is at its range: got 200 N in fz at rest, expected 180 N at most."),
        (shifted, "the force sensor is at its range: got 1"),
        (not_a_number, "the robot's state makes no sense: got wrench that is not finite, expected numbers."),
    ],
    ids=["dead", "fluttering", "half-dead", "noisy", "at-its-range", "shifted", "nan"],
)
def test_a_sensor_that_cannot_be_believed_is_told(peg_plant, rig, seen, message):
    assert message in refused(Faulty(peg_plant()[0], seen), rig)


@pytest.mark.parametrize("from_tick", [0, 2500])
def test_a_sensor_that_freezes_is_told_whenever_it_does(peg_plant, rig, from_tick):
    kept: list[np.ndarray] = []

    def seen(state: np.void, tick: int) -> None:
        if tick >= from_tick:
            kept.append(state["wrench"].copy())
            state["wrench"] = kept[0]

    message = refused(Faulty(peg_plant()[0], seen), rig)
    assert "the force sensor froze or died" in message


def test_an_arm_pressed_against_the_block_is_told_before_it_moves(peg_plant, rig):
    plant, controller, scene = peg_plant()
    down = scene.T_base_goal.copy()
    down[:3] += [0.015, 0.0, -0.03]
    controller.ask(controller.target_pose, down, ticks=5000, impedance=Impedance())
    plant.advance(controller, 5500)
    assert plant.data.ncon > 0
    robot = Faulty(plant)
    assert refused(robot, rig).startswith("something touches the arm: got ")
    assert robot.tick == 0


def pushed(plant, rig, force_n: tuple[float, float, float], from_tick: int) -> str:
    """What is told when a hand pushes the tool from a tick on."""
    hand = plant.data.xfrc_applied[plant.model.body("tool").id]

    def done(tau: np.ndarray, tick: int) -> np.ndarray:
        hand[:3] = force_n if tick >= from_tick else (0.0, 0.0, 0.0)
        return tau

    return refused(Faulty(plant, done=done), rig)


@pytest.mark.parametrize("from_tick", [1800, 3000, 4500])
def test_what_touches_the_tool_while_it_is_checked_is_told(peg_plant, rig, from_tick):
    message = pushed(peg_plant()[0], rig, (0.0, 0.0, -10.0), from_tick)
    assert message.startswith("something touches the tool: the force changed by 5.")


def test_what_leans_on_the_tool_all_the_time_is_told(peg_plant, rig):
    message = pushed(peg_plant()[0], rig, (0.0, 10.0, 0.0), 0)
    assert message.startswith("something touches the tool, or the sensor needs to be zeroed: got ")


def test_what_hangs_on_the_tool_is_told_as_the_mass_that_it_is(peg_plant, rig):
    message = pushed(peg_plant()[0], rig, (0.0, 0.0, -9.81), 0)
    assert message.startswith("the tool is not the rig's: got 1.4")


def test_an_arm_near_the_end_of_a_joint_is_told(peg_plant, rig):
    q = np.array([0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785])
    q[6] = 2.75
    message = refused(peg_plant(q_rad=q)[0], rig)
    assert message == ("joint 7 is too near to its end: got 0.147 rad left at 2.75 rad, expected 0.2 rad at least.")


def moving(state: np.void, tick: int) -> None:
    state["dq"][2] = 0.3


def mirrored(state: np.void, tick: int) -> None:
    state["R"][:, 0] *= -1.0


def weightless(state: np.void, tick: int) -> None:
    state["M"][6, 6] = -0.1


def nowhere(state: np.void, tick: int) -> None:
    state["q"][3] = np.inf


@pytest.mark.parametrize(
    ("seen", "message"),
    [
        (moving, "the arm is not at rest: got 0.3 rad/s in joint 3, expected 0.02 rad/s at most."),
        (mirrored, "the robot's state makes no sense: got R that is off a rotation by "),
        (weightless, "the robot's state makes no sense: got an inertia whose smallest eigenvalue is -"),
        (nowhere, "the robot's state makes no sense: got q that is not finite, expected numbers."),
    ],
)
def test_a_state_that_no_arm_at_rest_has_is_told_before_anything_is_commanded(peg_plant, rig, seen, message):
    robot = Faulty(peg_plant()[0], seen)
    assert refused(robot, rig).startswith(message)
    assert robot.tick == 0


def test_a_clock_that_stands_still_is_told(peg_plant, rig):
    def seen(state: np.void, tick: int) -> None:
        state["t_ns"] = 5

    assert "the robot's state or its clock stood still" in refused(Faulty(peg_plant()[0], seen), rig)


def test_an_arm_that_does_nothing_is_told(peg_plant, rig):
    message = refused(Faulty(peg_plant()[0], done=lambda tau, tick: 0.0 * tau), rig)
    assert message.startswith("the tool did not turn about x as asked: got ")


@pytest.mark.parametrize("strength", [0.6, 1.4])
def test_an_arm_that_is_weaker_or_stronger_than_it_says_is_told(peg_plant, rig, strength):
    """Its way under the push is the same: spring and push are off by the same factor."""
    message = refused(Faulty(peg_plant()[0], done=lambda tau, tick: strength * tau), rig)
    assert message.startswith("torque does not accelerate the arm as its inertia says: got ")
    assert float(message.split("got ")[1].split()[0]) == pytest.approx(strength, abs=0.05)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_jacobian_of_another_tool_centre_point_is_told(peg_plant, rig, axis):
    """Two centimetres off, in the tool's axes, as after a change of tool that somebody forgot to tell."""

    def seen(state: np.void, tick: int) -> None:
        off = 0.02 * state["R"][:, axis]
        state["J"][:3] += np.cross(state["J"][3:].T, off).T

    assert refused(Faulty(peg_plant()[0], seen), rig).startswith("pose and Jacobian are not of one point: got 0.00")


def test_an_arm_that_does_not_come_to_rest_is_told(peg_plant, rig):
    def done(tau: np.ndarray, tick: int) -> np.ndarray:
        return tau + np.array([3.0 * np.sin(4.0 * tick * 1e-3), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])

    message = refused(Faulty(peg_plant()[0], done=done), rig)
    assert message.startswith("the arm does not come to rest: got 0.0")


@pytest.mark.parametrize(
    "control",
    [
        ControlConfig(stiffness_max_n_m=150.0),
        ControlConfig(force_max_n=4.0, moment_max_nm=1.0),
        ControlConfig(turn_max_rad_s=0.05, ramp_s=0.0),
    ],
    ids=["soft", "weak", "slow"],
)
def test_narrow_limits_make_the_checks_smaller_and_not_fail(peg_plant, rig, control):
    plant, _, _ = peg_plant()
    start, furthest_m = plant.true_tcp_pose, 0.0

    def seen(state: np.void, tick: int) -> None:
        nonlocal furthest_m
        furthest_m = max(furthest_m, float(np.linalg.norm(plant.true_tcp_pose[:3] - start[:3])))

    report = check_startup(Faulty(plant, seen), Controller(rig, control), rig)
    assert report.compliance == pytest.approx((1.0, 1.0, 1.0), abs=0.1)
    assert furthest_m < 0.02


def test_a_cable_that_pulls_is_told(peg_plant, rig):
    """Something as stiff as half of the spring holds the tool: the way under the push is two thirds."""
    plant, _, _ = peg_plant()
    start, last = plant.true_tcp_pose[:3], np.zeros((6, 7))

    def seen(state: np.void, tick: int) -> None:
        last[:] = state["J"]

    def done(tau: np.ndarray, tick: int) -> np.ndarray:
        return tau + last[:3].T @ (300.0 * (start - plant.true_tcp_pose[:3]))

    message = refused(Faulty(plant, seen, done), rig)
    assert message.startswith("the tool does not give way as its stiffness says: a push of 5 N along x moved it by 5.")
    assert message.endswith("expected 8.3 0.0 0.0 mm within 20%.")
